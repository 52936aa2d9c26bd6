"""Figures under other people's settings of matplotlib, and of robots and runs with any names."""

import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

from sffr_gym import ConfigError
from sffr_workbench.figures import save_figures
from sffr_workbench.figures.style import DPI, LONGEST, canvas, drawing, legend, legend_columns, load_matplotlib, plain

mpl = pytest.importorskip("matplotlib")

CODE = """
import sys, warnings
from pathlib import Path
warnings.simplefilter("error")
from sffr_workbench.figures.style import canvas, save_figures
def paint():
    figure, axes = canvas(1, 1, 2.0)
    axes[0, 0].semilogy([1.0, 2.0])
    axes[0, 0].set_title("a title")
    return figure
file, = save_figures(Path(sys.argv[1]), {"a.png": paint})
print(file.stat().st_size, "matplotlib.pyplot" in sys.modules)
"""


def paint(name="name"):
    """A figure with a name wherever one may stand."""
    figure, axes = canvas(1, 1, 2.0)
    axes[0, 0].plot([0.0, 1.0], label=plain(name))
    axes[0, 0].set_title(plain(name))
    return legend(figure, axes[0, 0])


def elsewhere(folder, **environment):
    """Draw in a program of its own."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("MPL", "MATPLOTLIB", "DISPLAY"))}
    return subprocess.run(
        [sys.executable, "-c", CODE, str(folder)], env=kept | environment, capture_output=True, text=True, cwd=folder
    )


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    """What the program prints with the usual settings."""
    done = elsewhere(tmp_path_factory.mktemp("usual"))
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    "environment",
    [
        {"MPLBACKEND": "nonsense"},
        {"MPLBACKEND": "TkAgg"},
        {"MATPLOTLIBRC": "."},
        {"MPLCONFIGDIR": "/proc/not/there", "LC_ALL": "C", "PYTHONUTF8": "0"},
    ],
    ids=str,
)
def test_settings_of_matplotlib_change_nothing(environment, usual, tmp_path):
    """Backends that are not there, TeX, fonts that are not there, folders that cannot be written."""
    if "MATPLOTLIBRC" in environment:
        (tmp_path / "matplotlibrc").write_text(
            "text.usetex: True\nfont.family: Not There\nbackend: QtAgg\nfigure.dpi: 20\naxes.facecolor: red\n"
        )
    done = elsewhere(tmp_path, **environment)
    assert done.returncode == 0, done.stderr
    assert done.stdout == usual and usual.endswith("False\n")


def test_damaged_settings_are_an_error_in_a_line(tmp_path):
    (tmp_path / "matplotlibrc").write_bytes(b"\xff\xfe")
    done = elsewhere(tmp_path)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("sffr_gym.config.errors.ConfigError: matplotlib cannot be loaded")


def test_settings_of_the_program_stay(tmp_path):
    """Also when a painter fails."""
    before = dict(mpl.rcParams)
    with mpl.rc_context({"text.usetex": True, "font.size": 33.0}):
        within = dict(mpl.rcParams)
        save_figures(tmp_path, {"a.png": paint})
        with pytest.raises(ZeroDivisionError):
            save_figures(tmp_path, {"b.png": lambda: 1 / 0})
        assert dict(mpl.rcParams) == within
    assert dict(mpl.rcParams) == before


def test_without_matplotlib_it_says_what_to_install(monkeypatch):
    from sffr_workbench.common import extras

    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"not installed: matplotlib; pip install 'sffr-gym\[plot\]'"):
        load_matplotlib()


@pytest.mark.parametrize(
    "name",
    [
        "$x", "$\\frac{$", "a$b$c", "\\$", "_hidden", "太阳 وقت", "p\udcff", "a\nb\tc", "long " * 60, "%s {} <b>&amp;",
    ],
)  # fmt: skip
def test_names_are_drawn_as_they_stand(name, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (file,) = save_figures(tmp_path, {"a.png": lambda: paint(name)})
    from matplotlib.image import imread

    assert imread(file).shape[:2] == (2 * DPI, 10 * DPI)
    with drawing():
        figure = paint(name)
        (text,) = figure.legends[0].get_texts()
        figure.savefig(os.devnull, format="png")
        assert text.get_text() == plain(name)


def test_long_names_keep_both_ends_and_legends_their_width():
    name = f"first{'x' * 200}last"
    assert len(plain(name)) <= LONGEST and plain(name).startswith("first") and plain(name).endswith("last")
    assert plain("short") == "short"
    assert legend_columns(["a"] * 4) == 4 and 1 <= legend_columns([plain(name)] * 9) < 4 and legend_columns([]) == 0


def test_values_that_are_not_finite_leave_a_range():
    from sffr_workbench.figures.episode import _range

    assert np.isfinite(_range(np.zeros(1))).all()

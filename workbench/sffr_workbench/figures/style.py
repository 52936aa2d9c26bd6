"""How figures look, whatever they show: style, colours, axes, files. matplotlib is imported where it is used."""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sffr_gym import ConfigError
from sffr_gym.config.files import write_whole
from sffr_workbench.common import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 150
LONGEST, SHORT = 40, 16  # letters of a user's name of a run's part and of a robot's; the middle of longer ones is cut
INCHES, WIDTH = 10.0, 120  # of a figure, and letters of its legend beside each other
# Okabe and Ito's colours, which colour-blind people can tell apart.
POLICY_COLOURS = {
    "none": "#7F7F7F", "hsc": "#0072B2", "ahsc": "#D55E00", "ahsc-filtered": "#009E73", "random": "#CC79A7",
    "hsc-tuned": "#56B4E9", "lqr": "#E69F00",
}  # fmt: skip
OTHER_COLOURS = (  # of further policies, in turn; Tol's muted ones, as many as the benchmark needs
    "#882255", "#44AA99", "#000000", "#999933", "#332288", "#CC6677", "#117733", "#DDCC77", "#6699CC", "#661100",
)  # fmt: skip
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")  # of quantities that are no policies
STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.titlesize": 9, "axes.labelsize": 9, "legend.fontsize": 9, "axes.grid": True,
    "grid.color": "#E6E6E6", "grid.linewidth": 0.6, "axes.spines.top": False, "axes.spines.right": False,
    "axes.edgecolor": "#555555", "axes.axisbelow": True, "legend.frameon": False, "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-3, 4),
}  # fmt: skip

Painter = Callable[..., "Figure | None"]  # None where there is nothing to show


def policy_colours(policies: Iterable[str]) -> dict[str, str]:
    """Return a colour for each policy, the same in every figure for those that are shipped."""
    others = [policy for policy in policies if policy not in POLICY_COLOURS]
    return POLICY_COLOURS | {policy: OTHER_COLOURS[i % len(OTHER_COLOURS)] for i, policy in enumerate(others)}


def draw_figures(painters: Mapping[str, Painter], *data: Any) -> dict[str, bytes]:
    """Draw figures and return them as the contents of PNG files; one without anything to show has none.

    Args:
        painters: by file name.
        data: what they draw.

    Raises:
        ConfigError: see :func:`load_matplotlib`.
    """
    with drawing():
        drawn = {name: paint(*data) for name, paint in painters.items()}
        return {name: png(figure) for name, figure in drawn.items() if figure is not None}


def save_figures(folder: Path, painters: Mapping[str, Painter], *data: Any) -> list[Path]:
    """Draw figures into a folder, which is made if need be, and return the files; see :func:`draw_figures`."""
    contents = draw_figures(painters, *data)
    folder.mkdir(parents=True, exist_ok=True)
    return [write_whole(folder / name, content) for name, content in contents.items()]


def load_matplotlib() -> None:
    """Import matplotlib, also where ``MPLBACKEND`` names no backend: none is needed, since nothing is shown.

    Raises:
        ConfigError: if it is not installed or cannot be loaded, such as for a damaged ``matplotlibrc``.
    """
    require("plot", "matplotlib")
    if "matplotlib" in sys.modules:
        return
    backend = os.environ.pop("MPLBACKEND", "")  # one that it does not know would break the import
    try:
        settings = import_module("matplotlib").rcParams
    except Exception as error:  # whatever is wrong with the installation or the settings
        raise ConfigError(f"matplotlib cannot be loaded: {type(error).__name__}: {error}") from None
    finally:
        if backend:
            os.environ["MPLBACKEND"] = backend
    if backend:
        with suppress(ValueError):
            settings["backend"] = backend  # as the import does


@contextmanager
def drawing(style: Mapping[str, Any] = STYLE) -> Iterator[None]:
    """Let figures look the same whatever the user's settings of matplotlib are, and leave those as they were.

    Raises:
        ConfigError: see :func:`load_matplotlib`.
    """
    load_matplotlib()
    from matplotlib.style import context

    with context(["default", dict(style)]), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)  # drawn as boxes
        warnings.filterwarnings("ignore", "Data has no positive values", UserWarning)  # an error of exactly 0
        yield


def plain(name: str, most: int = LONGEST) -> str:
    """Return a name of the user's as matplotlib draws it as it stands: a line of ``most`` letters without formulas."""
    line = " ".join(name.encode("utf-8", "replace").decode().split())
    if len(line) > most:
        line = f"{line[: most // 2 - 2]}...{line[1 - most // 2 :]}"
    return f" {line}".replace("$", "\\$") if line.startswith("_") else line.replace("$", "\\$")


def legend_columns(labels: Sequence[str], inches: float = INCHES) -> int:
    """Return how many entries of a legend stand beside each other in a figure so wide, up to the usual width."""
    letters = int(WIDTH * min(inches / INCHES, 1.0))
    return min(len(labels), max(letters // (6 + max(map(len, labels), default=0)), 1))


def png(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file; ``savefig`` would draw it twice, once for the layout alone."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    picture = io.BytesIO()
    figure.set_dpi(DPI)
    FigureCanvasAgg(figure).print_png(picture)
    return picture.getvalue()


def canvas(rows: int, columns: int, height: float, **sharing: Any) -> tuple[Figure, Any]:
    """Return a figure of the usual width and its axes (rows, columns)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(INCHES, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **sharing)


def legend(figure: Figure, axes: Axes, **options: Any) -> Figure:
    """Put one legend above everything, of the lines in ``axes``."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=legend_columns(labels, figure.get_figwidth()), **options
    )
    align_labels(figure)
    return figure


def align_labels(figure: Figure) -> None:
    """Align the labels at the left; of axes without one alone, which matplotlib would measure again and again."""
    figure.align_ylabels([axes for axes in figure.axes if axes.get_ylabel()])


def title_with_limit(axes: Axes, name: str, limit: float, unit: str) -> None:
    """Write what is drawn above axes, and its limit, which would squash the curves as a line."""
    axes.set_title(f"{name} [{unit}]", loc="left")
    axes.set_title(f"limit \u00b1{limit:g} {unit}", loc="right", color="#777777", fontsize=8)

"""The checks of `sffr verify`, shortened, each section where its library is installed; and their report."""

import math
import re
from html.parser import HTMLParser
from importlib import import_module

import pytest

from sffr_gym.compile.library import load_library
from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.verify import Check, CheckFigure, run_checks, suite, write_page
from sffr_workbench.verify.check import make_check, relative, rms

LIBRARIES = {
    "equations": ["sympy"],
    "control_law": ["sympy"],
    "rigid": ["pinocchio"],
    "coupling": [],
    "staggered": [],
    "conservation": [],
    "grasp": ["mujoco", "exudyn"],
    "fig5": ["mujoco", "exudyn"],
    "large_motion": ["mujoco", "exudyn"],
}
SLOW = {"fig5", "grasp", "large_motion"}
INTEGRATING = {
    "conservation",
    "staggered",
    "fig5",
    "grasp",
    "large_motion",
}  # a hundred thousand steps, too many for the interpreter


SECTIONS = [
    pytest.param(name, libraries, marks=pytest.mark.slow if name in SLOW else (), id=name)
    for name, libraries in LIBRARIES.items()
]


def passing(name="what", **changes):
    return Check(name, "other", 1.0e-12, 1.0e-9, "m", True, 0.5, "why", section="Part")._replace(**changes)


@pytest.mark.parametrize(("name", "libraries"), SECTIONS)
def test_section_passes(name, libraries):
    for library in libraries:
        pytest.importorskip(library)
    if load_library() is None and name in INTEGRATING:
        pytest.skip("not compiled")
    for function in import_module(f"sffr_workbench.verify.{name}").checks(quick=True):
        check = function()
        assert check.passed, f"{check.name}: {check.error:.3g} {check.unit}, allowed {check.allowed:.3g}. {check.note}"
        assert math.isfinite(check.error)


def test_every_section_is_tested_here():
    assert {name for _, name in suite.SECTIONS} == set(LIBRARIES)


@pytest.mark.parametrize(("error", "passed"), [(1.0, True), (1.0 + 1e-9, False), (math.nan, False), (math.inf, False)])
def test_a_check_passes_up_to_what_is_allowed(error, passed):
    assert make_check("", "", error, 1.0, "", "").passed is passed


def test_measures():
    assert rms([3.0, 4.0, 0.0, 0.0]) == pytest.approx(2.5)
    assert relative([1.0, -4.0], [1.5, -4.0]) == pytest.approx(0.125)


@pytest.mark.skipif(load_library() is None, reason="not compiled")
@pytest.mark.parametrize("exchanged", [False, True])
def test_panels_that_differ_are_told_apart(exchanged):
    """By the points of mass along each panel, an implementation of its own; not by a robot with the two exchanged."""
    from sffr_workbench.verify import foreshortening, motion

    other = [key.replace("mounts.0", "mounts.2").replace("mounts.1", "mounts.0") for key in motion.UNLIKE]
    other = [key.replace("mounts.2", "mounts.1") for key in other]
    robot, pieces = ("object=null", "panel.elements=2"), motion.pulse(2.5, seconds=3.0)
    known = foreshortening.simulate(motion.at_rest(*robot, *(other if exchanged else motion.UNLIKE)), pieces)
    found = motion.simulate(motion.at_rest(*robot, *motion.UNLIKE, "panel.foreshortening=true"), pieces)
    error = rms(found.tips[..., 1] - known.tips[..., 1]) / rms(known.tips[..., 1])
    assert (error > 0.3) if exchanged else (error < 1e-3)


def test_a_wrong_sign_is_found(monkeypatch):
    """The panel's gyroscopic coupling with the other sign, in the readable form: derivation and kernels disagree."""
    pytest.importorskip("sympy")
    from sffr_gym.physics import monolithic
    from sffr_workbench.verify import coupling, equations

    right = monolithic.panel_equations

    def wrong(beam, delta, delta_d, qf, qfd):
        return right(beam._replace(N=beam.N.T), delta, delta_d, qf, qfd)

    monkeypatch.setattr(monolithic, "panel_equations", wrong)
    assert not equations.arrays(states=1).passed
    assert not coupling.checks(quick=True)[0]().passed


def test_a_missing_library_and_a_broken_check_are_failures(monkeypatch):
    def broken(quick):
        def diverges():
            raise FloatingPointError("no solution")

        return [diverges, passing]

    module = type("Module", (), {"checks": staticmethod(broken)})

    def find(name):
        if name == "sffr_workbench.verify.first":
            raise ModuleNotFoundError("No module named 'engine'", name="engine")
        return module

    monkeypatch.setattr(suite, "SECTIONS", (("One", "first"), ("Two", "second")))
    monkeypatch.setattr(suite, "import_module", find)
    begun = []
    missing, raised, good = run_checks(quick=True, progress=lambda what, done, total: begun.append((what, done, total)))
    assert begun[1:] == [
        ("Fail a section whose library is missing, or a check that raised", 0, 3),
        ("", 1, 3),
        ("", 2, 3),
    ]
    assert suite.missing_libraries(["first", "second"]) == {"first": "engine"}
    assert not missing.passed and "engine" in missing.note and "sffr-gym[verify]" in missing.note
    assert not raised.passed and raised.name == "diverges" and raised.note == "FloatingPointError: no solution"
    assert good.passed and good.section == "Two" and good.seconds < 0.5


def test_a_simulator_that_does_not_run_is_a_failure(monkeypatch):
    def no_simulator():
        raise FloatingPointError("not finite")

    monkeypatch.setattr(suite, "Simulator", no_simulator)
    (failed,) = run_checks(quick=True, sections=[])
    assert not failed.passed and failed.note == "FloatingPointError: not finite"


def test_missing_compiled_code_is_a_failure(monkeypatch):
    """Else every check would pass on kernels that run as Python, which are not what they are about."""
    monkeypatch.setattr(suite, "load_library", lambda: None)
    monkeypatch.setattr(suite, "is_interpreted", lambda: False)
    (failed,) = run_checks(quick=True, sections=[])
    assert not failed.passed and "no compiled code" in failed.note


def test_page_has_every_check_and_figure(tmp_path):
    pytest.importorskip("matplotlib")

    def draw():
        from matplotlib.figure import Figure

        figure = Figure()
        figure.subplots().plot([0.0, 1.0])
        return figure

    figure = CheckFigure("Curves & lines", "What to see", draw)
    checks = [passing("a < b", figures=(figure,)), passing("second", passed=False, section="Other")]
    with RunFolder.claim(tmp_path / "new", "verification") as run:
        text = write_page(checks, run).read_text(encoding="utf-8")

    class Reader(HTMLParser):
        words, images = "", 0

        def handle_data(self, data):
            self.words += data

        def handle_starttag(self, tag, attributes):
            self.images += tag == "svg"

    reader = Reader()
    reader.feed(text)
    for expected in ("a < b", "second", "other", "1e-12 m", "1e-09 m", "why", "1 failed", "Curves & lines", "Other"):
        assert expected in reader.words
    assert reader.images == 1
    assert not re.search(r"(src|href)=.?http", text)  # nothing is fetched

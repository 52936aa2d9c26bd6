"""The measurements of speed: tiny versions of all, what is compared is the same motion, and how targets are checked."""

import io
import json
import math
import subprocess
import sys
from statistics import median

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from sffr_gym import ConfigError
from sffr_workbench.cli import app as cli

pytest.importorskip("mujoco")
pytest.importorskip("psutil")

from sffr_baselines import make_policy
from sffr_baselines.closed_loop import make_record
from sffr_gym.task.status import RUNNING
from sffr_workbench.speed import environments, measure, page, suite
from sffr_workbench.speed.circle import CHECKPOINTS, Controller, Loop, close_loop, drive, make_course, relative_errors
from sffr_workbench.speed.measure import Row, Section
from sffr_workbench.speed.mujoco_circle import MujocoPlant
from sffr_workbench.speed.profile import floor
from sffr_workbench.speed.scipy_circle import ScipyPlant
from sffr_workbench.speed.targets import check_targets

KEYS = {
    "physics": {"ours", "RK4", "implicitfast", "DOP853", "Radau"},
    "loop": {"ahsc"},
    "gym": {"ours", "peer"},
    "vector": {"ours-1", "sync-1", "async-1", "ours-2", "sync-2", "async-2"},
    "growth": {"elements-1", "elements-2", "links-6", "links-7"},
    "batches": {"random", "still", "mismatch", "large-random", "large-still"},
    "memory": {"vector", "single"},
    "starts": {"single", "damping", "import"},
    "profile": {"equations", "integrator", "law", "view", "rest", "loop", "batch", "env", "made"},
}
PROCESSES = {"memory", "starts"}  # whose rounds start several, a second or more each
MAY_BE_NEGATIVE = {"integrator", "rest"}  # differences of measured times


@pytest.fixture(autouse=True)
def allow_underflow_in_libraries():
    """Our arrays are checked elsewhere; SciPy's step control divides by zero on purpose."""
    with np.errstate(all="ignore"):
        yield


@pytest.fixture(scope="module")
def course():
    return make_course(0.1)


@pytest.mark.parametrize("name", KEYS)
def test_every_measurement_gives_finite_positive_figures(name):
    section = suite.MEASUREMENTS[name](1 if name in PROCESSES else 2, True)
    assert section.name == name
    assert {row.key for row in section.rows} == KEYS[name]
    for row in section.rows:
        assert all(math.isfinite(figure) for figure in row.samples)
        assert row.key in MAY_BE_NEGATIVE or min(row.samples) > 0.0
        assert not row.versus or section.ratio(row) == section[row.versus].median / row.median


def test_work_and_precision_has_all_methods_and_a_picture():
    from sffr_workbench.speed.precision import STYLES, draw_picture, precision

    section = precision(1, True)
    assert {row.what.partition(",")[0] for row in section.rows} == set(STYLES)
    assert all(0.0 < row.extra["error_end"] < 1e-2 for row in section.rows)
    errors = [section[f"sffr-gym ETDRK4 {step} ms"].extra["error_max"] for step in (2, 1)]
    assert errors[1] < errors[0] / 8 < 1e-7
    assert len(draw_picture(section)) > 10_000


def test_a_drive_from_its_forces_is_the_closed_loop_to_the_bit(course):
    """The checkpoint after k periods is the state at the start of period k."""
    record = make_record(course.plant, course.ticks, 1)
    loop = Loop(course, course.plant, make_policy("ahsc", course.params).law, record)
    again = drive(course, close_loop(course))
    assert len(again.rigid) == CHECKPOINTS
    for _ in range(2):  # each starts from the start
        record.p[:] = np.nan
        assert loop() == (course.ticks, RUNNING)
        np.testing.assert_array_equal(again.rigid[:-1, :9], record.p[1:, :9])
        np.testing.assert_array_equal(again.rigid[:-1, 9:], record.p[1:, -3:])


def test_a_controller_for_engines_commands_what_the_loop_does(course):
    record = make_record(course.plant, course.ticks, 1)
    Loop(course, course.plant, make_policy("ahsc", course.params).law, record)()
    controller, forces = Controller(course), close_loop(course)
    for tick in range(course.ticks):
        controller(tick, record.p[tick], record.v[tick])
        np.testing.assert_allclose(controller.applied, record.applied[tick], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(controller.tau, forces[tick], rtol=1e-9, atol=1e-9)


def test_engines_drive_the_same_way(course):
    ours = drive(course, close_loop(course))
    scipy = ScipyPlant(course, "DOP853", 1e-9).drive()
    assert relative_errors(scipy, ours).max() < 1e-7
    mujoco, forces = MujocoPlant(course, "RK4", 1.0e-3).drive()
    assert forces.shape[0] == course.ticks
    np.testing.assert_allclose(mujoco.rigid, ours.rigid, atol=5e-3)  # two rigid segments are another panel
    assert relative_errors(mujoco, ours).max() > 1e-6


def test_mujoco_converges_in_small_steps_when_its_solver_may_not_stop_early(course):
    coarse, fine, finest = (
        MujocoPlant(course, "RK4", 2.0e-3 / steps, tolerance=0.0).drive()[0] for steps in (1, 4, 16)
    )
    assert relative_errors(fine, finest).max() < relative_errors(coarse, finest).max() / 4 < 1e-9


def test_mujoco_repeats_its_drive_and_returns_to_the_start(course):
    plant = MujocoPlant(course, "implicitfast", 2.0e-3)
    _, forces = plant.drive()
    start = plant.data.qpos.copy()
    assert plant.replay(forces) > 0.0
    np.testing.assert_array_equal(plant.data.qpos, start)


def test_error_counts_the_tips_alone_too(course):
    ours = drive(course, close_loop(course))
    bent = ours._replace(tips=ours.tips * 1.001)
    assert relative_errors(bent, ours).max() == pytest.approx(1e-3, rel=1e-6)
    assert relative_errors(ours, ours).max() == 0.0


def test_counting_finds_every_operation_of_a_known_formula():
    code = (
        "import numpy as np, math\n"
        "from sffr_workbench.speed import count\n"
        "x = count.counting(np.array([3.0, 4.0]))\n"
        "y = 1.0 - x[0] * x[1] + x[0] / 2.0\n"
        "z = count._function('sqrt')(y * y) + count._function('cos')(x[1])\n"
        "print(float(z), *[count._count[kind] for kind in count.KINDS])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    value, *counts = done.stdout.split()
    assert float(value) == pytest.approx(9.5 + math.cos(4.0))
    assert list(map(int, counts)) == [3, 2, 1, 1, 1]


def test_floor_adds_up():
    count = {"add": 10, "multiply": 20, "divide": 3, "sqrt": 2, "transcendental": 1}
    rates = {"multiply_add": 0.1, "chain": 1.0, "divide": 2.0, "sqrt": 4.0, "cos": 10.0}
    made = floor(count, rates)
    assert made["operations"] == 36
    assert made["floor_us"] == pytest.approx(1e-3 * (3 + 6 + 8 + 10))
    assert made["serial_us"] == pytest.approx(1e-3 * (30 + 6 + 8 + 10))


def test_contenders_take_turns_after_a_warm_up():
    calls = []
    contenders = {name: lambda name=name: calls.append(name) or float(len(calls)) for name in "abc"}
    samples = measure.rounds(contenders, 3)
    assert "".join(calls) == "abc" + "abc" + "bca" + "cab"
    assert samples["a"] == (4.0, 9.0, 11.0)


def test_environments_without_memory_for_their_processes_are_named(monkeypatch):
    monkeypatch.setattr(environments, "MEMORY_PER_PROCESS", 2**60)
    section = environments.vector(1, True, sizes=(1,))
    assert {row.key for row in section.rows} == {"ours-1", "sync-1"}
    assert any("do not fit into memory" in remark for remark in section.remarks)


# How targets are checked, with figures made up.


def made_up(**changes):
    figures = {
        "physics": {"ours": 800.0, "RK4": 100.0, "implicitfast": 300.0},
        "loop": {"ahsc": 500.0},
        "gym": {"ours": 60_000.0, "peer": 19_000.0},
        "vector": {"ours-1024": 1_600_000.0, "sync-1024": 19_000.0, "async-16": 15_000.0},
        "batches": {"random": 1.5e6, "still": 1.6e6, "mismatch": 1.6e6, "large-random": 1.5e6, "large-still": 1.7e6},
        "starts": {"single": 0.9, "import": 0.7},
        "memory": {"vector": (300.0,) * 20},
        "precision": {"sffr-gym ETDRK4 2 ms": 1.0},
    }  # fmt: skip
    for path, value in changes.items():
        section, key = path.split("__")
        figures[section][key.replace("_", "-")] = value
    versus = {"physics": "ours", "gym": "ours", "vector": "ours-1024", "batches": ""}
    return [
        Section(name, name, [
            Row(
                key, key, "unit", value if isinstance(value, tuple) else (value,),
                versus="" if key.startswith("ours") else versus.get(name, ""),
                extra=dict.fromkeys(("error_end", "error_max"), 1e-9),
            )
            for key, value in rows.items()
        ])
        for name, rows in figures.items()
    ]  # fmt: skip


GROWN = "change of resident memory after a tenth of the run"


def missed(sections):
    return [target.what for target in check_targets(sections) if not target.met]


def test_all_targets_can_be_met():
    assert len(check_targets(made_up())) == 13
    assert missed(made_up()) == []


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"physics__RK4": 115.0}, "physics alone against MuJoCo RK4"),
        ({"physics__implicitfast": 401.0}, "physics alone against MuJoCo implicitfast"),
        ({"loop__ahsc": 399.0}, "closed loop with AHSC"),
        ({"gym__peer": 20_001.0}, "gym.make against HalfCheetah-v5"),
        ({"vector__async_16": 20_001.0}, "the same against the fastest HalfCheetah-v5 vector environment"),
        ({"batches__large_random": 1.49e6}, "65,536 environments against 1,024, random actions"),
        ({"batches__still": 1.9e6}, "random actions with their resets against none"),
        ({"batches__mismatch": 1.1e6}, "robots that differ against such that are alike"),
        ({"starts__import": 0.81}, "import sffr_gym"),
        ({"starts__single": math.nan}, "start to first step of gym.make"),
        ({"memory__vector": (290.0, 300.0, *[300.0] * 17, 303.1)}, GROWN),
    ],
)  # fmt: skip
def test_each_target_can_be_missed(change, what):
    assert missed(made_up(**change)) == [what]


def test_memory_may_grow_in_the_first_tenth():
    assert missed(made_up(memory__vector=(200.0, 300.0, *[300.5] * 18))) == []


def test_the_error_is_a_target():
    sections = made_up()
    sections[-1].rows[0].extra["error_max"] = 2e-6
    assert missed(sections) == ["relative error over the circle at 2 ms"]


def test_targets_of_what_was_not_measured_are_left_out():
    assert [target.what for target in check_targets(made_up()[1:2])] == ["closed loop with AHSC"]


# What people and machines get.


def text_of(table, width=120):
    console = Console(file=io.StringIO(), width=width)
    console.print(table)
    return console.file.getvalue()


def test_tables_show_figures_and_verdicts():
    physics, *_ = sections = made_up(loop__ahsc=(300.0, 310.0, 290.0))
    assert "8 times" in text_of(page.section_table(physics))
    shown = text_of(page.target_table(check_targets(sections)))
    assert "missed" in shown and shown.count("met") == 12 and "300 times real time" in shown


def test_result_loads_and_holds_everything():
    sections = made_up()
    result = json.loads(page.result_json(sections, check_targets(sections), 7, False, ["sffr", "bench"]))
    assert result["command"] == "sffr bench" and result["repeats"] == 7
    assert result["machine"]["cores"] >= 1 and result["machine"]["versions"]["mujoco"]
    assert [target["met"] for target in result["targets"]] == [True] * 13
    for section in sections:
        for row, entry in zip(section.rows, result["sections"][section.name]["rows"], strict=True):
            assert entry["samples"] == list(row.samples) and entry["median"] == median(row.samples)
    assert result["sections"]["physics"]["rows"][1]["ours_is_times"] == 8.0


def test_doc_keeps_its_words_and_takes_the_tables(tmp_path):
    file, sections = tmp_path / "speed.md", made_up()
    file.write_text(f"Before.\n{page.BEGIN}\nold\n{page.END}\nAfter.\n")
    for _ in range(2):
        with page.claimed_doc(file, drawn=True) as write:
            write(sections, check_targets(sections), ["sffr", "bench"])
    text = file.read_text()
    assert text.startswith("Before.\n") and text.endswith("After.\n") and "old" not in text
    assert "images/work_precision.png" in text and (tmp_path / "images" / "work_precision.png").is_file()
    assert text.count("| closed loop with AHSC | 500 times real time | at least 400 times real time | met |") == 1


def test_doc_without_markers_is_an_error(tmp_path):
    (tmp_path / "speed.md").write_text("nothing")
    with pytest.raises(ConfigError, match="must hold the lines"):
        page.check_doc(tmp_path / "speed.md")
    with pytest.raises(ConfigError, match="No such file"):
        page.check_doc(tmp_path / "missing.md")


def test_a_picture_of_others_is_in_the_way(tmp_path):
    """It is told before anything is measured, and stays."""
    file, picture = tmp_path / "speed.md", tmp_path / "images" / "work_precision.png"
    file.write_text(f"{page.BEGIN}\n{page.END}\n")
    picture.parent.mkdir()
    picture.write_text("mine")
    with pytest.raises(ConfigError, match="was not written by this run"), page.claimed_doc(file, drawn=True):
        pass
    assert picture.read_text() == "mine"
    with page.claimed_doc(file, drawn=False) as write:
        write(made_up()[:1], [], ["sffr", "bench"])
    assert "### physics" in file.read_text()


def test_command_writes_what_it_promises(tmp_path):
    arguments = ["bench", "--quick", "--only", "loop,growth", "--out", str(tmp_path)]
    result = CliRunner().invoke(cli.app, arguments)
    assert result.exit_code == 0, result.output
    again = CliRunner().invoke(cli.app, arguments)
    assert again.exit_code == 2 and "--overwrite" in again.output
    assert set(json.loads((tmp_path / "bench.json").read_text())["sections"]) == {"loop", "growth"}
    assert "Closed loop with AHSC" in result.output and "bench.json" in result.output


def test_unknown_measurement_is_named_with_the_nearest():
    result = CliRunner().invoke(cli.app, ["bench", "--only", "phisics"])
    assert result.exit_code == 2
    assert "did you mean 'physics'?" in result.output

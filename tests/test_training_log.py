"""A training's table: what of a logger's values is in it, how it grows, and how it goes on after a kill."""

import numpy as np
import pytest

from sffr_agents.folder import PROGRESS
from sffr_agents.log import Board, CsvLog, numbers
from sffr_gym import ConfigError


def lines(file):
    return file.read_text().splitlines()


def test_numbers_are_those_of_the_whole_run():
    """Scalars of NumPy as Python's own; no texts, pictures or arrays, and nothing of a process, which a kill ends."""
    logged = {
        "score/cost": np.float32(0.5), "count": np.int64(3), "loss": np.array(2.0), "flag": True, "rate": 1e-3,
        "picture": np.zeros((2, 2)), "row": np.zeros(1), "text": "ppo", "nothing": None,
        "time/fps": 100, "time/iterations": 3, "time/time_elapsed": 9.0, "time/episodes": 4,
    }  # fmt: skip
    found = numbers(logged)
    assert found == {"score/cost": 0.5, "count": 3, "loss": 2.0, "flag": True, "rate": 1e-3, "time/episodes": 4}
    assert {type(value) for value in found.values()} <= {int, float, bool}


def test_a_row_is_added_where_a_new_column_writes_the_table_anew(tmp_path):
    """Or a training of millions of steps would write more and more."""
    file = tmp_path / PROGRESS
    table = CsvLog(file)
    table.write({"loss": 1.0}, {}, 8)
    first = file.stat().st_ino
    table.write({"loss": 2.0}, {}, 16)
    assert file.stat().st_ino == first and lines(file) == ["steps,loss", "8,1.0", "16,2.0"]
    table.write({"cost": 3.0}, {}, 24)
    assert file.stat().st_ino != first and lines(file) == ["steps,loss,cost", "8,1.0,", "16,2.0,", "24,,3.0"]


@pytest.mark.parametrize("torn", ["", "1", "16,2."])
@pytest.mark.parametrize(("steps", "kept"), [(7, []), (8, ["8,1.0"]), (15, ["8,1.0"]), (16, ["8,1.0", "16,2.0"])])
def test_a_table_keeps_the_rows_up_to_where_the_training_goes_on(tmp_path, torn, steps, kept):
    """Later ones, and one that was cut off, are of the process that was killed."""
    file = tmp_path / PROGRESS
    table = CsvLog(file)
    for step in (8, 16):
        table.write({"loss": step / 8.0}, {}, step)
    file.write_text(file.read_text() + torn)
    table = CsvLog(file, steps)
    table.write({"loss": 5.0}, {}, 24)
    table.write({"loss": 6.0}, {}, 32)
    assert lines(file) == ["steps,loss", *kept, "24,5.0", "32,6.0"]


def test_a_table_goes_on_without_a_file_as_a_new_one(tmp_path):
    """As of a training that was killed before its first row."""
    table = CsvLog(tmp_path / PROGRESS, 8)
    table.write({"loss": 5.0}, {})
    assert lines(tmp_path / PROGRESS) == ["steps,loss", "0,5.0"]


def test_a_table_whose_steps_are_no_numbers_is_damaged(tmp_path):
    (tmp_path / PROGRESS).write_text("steps,loss\n8,1.0\nmany,2.0\n")
    with pytest.raises(ConfigError, match=r"progress\.csv: steps = 'many': must be a whole number"):
        CsvLog(tmp_path / PROGRESS, 8)


@pytest.mark.parametrize(("steps", "kept"), [(7, [16]), (8, [8, 16]), (9, [8, 9, 16])])
def test_tensorboard_forgets_what_came_after_the_step_where_a_training_goes_on(tmp_path, steps, kept):
    """From the very next step on."""
    pytest.importorskip("tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    for begun, written in (0, (8, 9)), (steps, (16,)):
        board = Board(tmp_path, begun)
        for step in written:
            board.write({"loss": 1.0 * step}, {"loss": ()}, step)
        board.close()
    accumulator = EventAccumulator(str(tmp_path)).Reload()
    assert [event.step for event in accumulator.Scalars("loss")] == kept

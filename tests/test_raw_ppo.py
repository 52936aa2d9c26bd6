"""The plain learner on the raw environment: it runs, and leaves what its docs say."""

import csv
import subprocess
import sys

import numpy as np
import pytest

raw_ppo = pytest.importorskip("sffr_agents.raw_ppo")


@pytest.mark.slow
def test_a_short_training_leaves_table_and_picture(tmp_path):
    """Two updates; the same folder again needs --overwrite."""
    command = [sys.executable, "-m", "sffr_agents.raw_ppo", "--steps", "20000", "--out", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    with open(tmp_path / "run" / raw_ppo.TABLE, encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["steps"]) for row in rows] == [16384.0, 32768.0]
    values = np.array([[float(row[name]) for name in raw_ppo.COLUMNS] for row in rows])
    per_period = values[:, 1] / (values[:, 2] / raw_ppo.PERIOD)
    assert (0.0 < per_period).all() and (per_period <= 1.0).all()
    assert (tmp_path / "run" / raw_ppo.PICTURE).read_bytes().startswith(b"\x89PNG")
    again = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert again.returncode == 1 and "--overwrite" in again.stderr


def test_what_is_there_is_kept_and_a_table_becomes_a_picture(tmp_path):
    (tmp_path / raw_ppo.TABLE).write_text("mine")
    with pytest.raises(SystemExit, match="--overwrite"):
        raw_ppo.main(steps=1, out=tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == [raw_ppo.TABLE]
    picture = raw_ppo.draw(np.array([[16384.0, 20.0, 0.5], [32768.0, 40.0, 0.9]]))
    assert picture.startswith(b"\x89PNG")

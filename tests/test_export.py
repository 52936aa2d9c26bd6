"""Files for other tools: linear models as matrices."""

import numpy as np
import pytest
from command_line import sffr
from scipy.io import loadmat

from sffr_gym import Simulator, load_params


def test_linearize_writes_the_model_for_numpy(tmp_path):
    file = tmp_path / "model.npz"
    result = sffr("linearize", "--out", file, "--set", "panel.EI=25")
    assert result.exit_code == 0, result.output
    assert "28 states, 15 inputs, 43 outputs" in result.output
    found, model = np.load(file), Simulator(load_params().with_overrides("panel.EI=25")).linearize()
    np.testing.assert_array_equal(found["A"], model.A)
    np.testing.assert_array_equal(found["Bd"], model.discrete().B)
    assert found["inputs_names"][6] == "thrust_x"
    assert found["states_units"].tolist() == [label.unit for label in model.states]
    assert found["Ts"] == 2e-3


def test_linearize_writes_the_model_for_matlab(tmp_path):
    file = tmp_path / "model.mat"
    assert sffr("linearize", "--at", "start", "--scenario", "patches", "--out", file).exit_code == 0
    found = loadmat(file, squeeze_me=True)
    assert found["B"].shape == (28, 25)
    assert found["inputs_names"][0] == "left_piezo1"
    assert found["outputs_units"][0] == "m"
    assert found["drift"][0] == pytest.approx(0.85)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "model.csv"], ["model.csv", ".mat or .npz"]),
        (["--set", "initial.q.3=1.9"], ["initial.q"]),
        (["--scenario", "nowhere"], ["nowhere"]),
    ],
)
def test_linearize_says_what_is_wrong(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    result = sffr("linearize", *arguments)
    assert result.exit_code == 2
    assert all(word in result.output for word in words)
    assert list(tmp_path.iterdir()) == []

"""What a program hands over of the wrong kind is refused by name, before anything runs, and never answered by NaN."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from command_line import sffr

from sffr_baselines import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym import ConfigError, SFFRFlexEnv, Simulator, load_params
from sffr_workbench import evaluate

SHORT = {"name": "short", "description": "a tenth of a second", "duration": 0.1}


@pytest.mark.parametrize("policies", ["ahsc", b"ahsc", None, 3, ["none", 3], Path("ahsc")])
def test_policies_are_a_list_of_names(policies):
    """Not the letters of one name."""
    with pytest.raises(
        ConfigError, match=r"^policies = .*: must be a list of names such as \['ahsc', 'mine.py:MyLaw'\]$"
    ):
        evaluate(policies, SHORT)


def test_a_policy_may_be_named_by_a_path(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import numpy as np\nfrom sffr_baselines import ControlLaw\n\n\nclass Still(ControlLaw):\n"
        "    def __call__(self, obs):\n        return np.zeros(len(self.limit))\n"
    )
    assert list(evaluate(iter([tmp_path / "mine.py:Still"]), SHORT).table) == ["Still"]


@pytest.mark.parametrize("stride", [0, -1, 1.5, True, "2"])
def test_a_stride_is_a_number_of_periods(stride):
    env = SFFRFlexEnv(SHORT)
    with pytest.raises(ValueError, match="stride must be a whole number of control periods, at least 1, got"):
        rollout(env, make_policy("none", env), 0, stride=stride)


def test_a_stride_beyond_the_episode_keeps_its_start():
    """Without the memory of so many periods."""
    env = SFFRFlexEnv(SHORT)
    assert rollout(env, make_policy("none", env), 0, stride=10**12).t.tolist() == [0.0]


@pytest.mark.parametrize("overrides", [["panel.EI=25"], None, 3, b"panel.EI=25"])
def test_an_override_is_a_text(overrides):
    with pytest.raises(ConfigError, match=r"must be a text such as 'panel\.EI=25', each by itself"):
        load_params().with_overrides(overrides)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ({"panel": {"EI": 25}}, "a mapping is given .* as params="),
        (3, "^3: must be the path of a file"),
        (b"x", "path"),
    ],
)
def test_parameters_are_read_from_files(path, message):
    with pytest.raises(ConfigError, match=message):
        load_params(path)


def test_a_linear_model_knows_its_own_states_and_names():
    model = Simulator().linearize()
    for other in ("panel.elements=2", "object=null", "panel.mounts=[]"):
        state = Simulator(load_params().with_overrides(other)).initial_state()
        with pytest.raises(ValueError, match="state is one of another robot"):
            model.deviation(state)
    with pytest.raises(KeyError, match="'state': must be one of states, inputs, outputs"):
        model.find("state", "base_x")
    with pytest.raises(KeyError, match="3: no such inputs"):
        model.find("inputs", 3)


def test_a_linear_model_has_no_numbers_that_are_not_finite():
    plant = Simulator()
    with pytest.raises(ValueError, match="the model grows beyond all numbers"):
        plant.linearize().discrete(1e9)
    state = plant.initial_state()
    with pytest.raises(FloatingPointError, match="no finite numbers at this state"):
        plant.linearize(dataclasses.replace(state, qf=state.qf + 1e200))


def test_the_ending_of_a_linear_model_may_be_in_capitals(tmp_path):
    assert sffr("linearize", "-o", tmp_path / "MODEL.NPZ").exit_code == 0
    assert np.load(tmp_path / "MODEL.NPZ")["A"].shape == (28, 28)


def test_a_number_of_too_many_digits_is_told_as_that():
    result = sffr("evaluate", "none", "-n", "9" * 23)
    assert result.exit_code == 2 and "is no whole number of at most 18 digits" in result.output


def test_the_nearest_pose_has_an_angle_within_a_turn():
    with pytest.raises(ConfigError, match="nearest that can be held is") as error:
        Simulator().reach([1e9, 0.0, 0.0])
    pose = [float(each) for each in str(error.value).rpartition("[")[2].rstrip("]").split(",")]
    assert abs(pose[2]) <= 2.0 * np.pi
    Simulator().reach(pose)  # as printed
    with pytest.raises(ValueError, match="pose must be a list of numbers, got 'auto'; left out it is found"):
        Simulator().reach("auto")

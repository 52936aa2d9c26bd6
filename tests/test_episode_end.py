"""How an episode of `SFFRFlex-v0` ends before its time."""

import numpy as np
import pytest
from grasping_robots import THREE_ARMS, grasping_params
from stepping import N_ACTIONS, assert_healthy, rollout

from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.status import RUNNING, Failure, status_of
from sffr_gym.task.task_model import make_task_model

BASE_ALONE = ["object=null", "arms=[]", "panel.mounts=[]", "initial.q=[0, 0, 0]", "initial.qd=[0.85, 0, 0]"]


def run_until_end(env, action, steps=600):
    """Hold an action until the episode ends; outputs and the states after each step."""
    outputs, states = [], []
    for _ in range(steps):
        outputs.append(env.step(action))
        states.append(env.state())
        if outputs[-1][2]:
            break
    return outputs, states


@pytest.mark.parametrize("panel", [0, 1])
def test_tip_beyond_range_terminates(panel):
    """Full voltage bends a panel; the episode ends with the first state whose tip is beyond a quarter of its length."""
    env = SFFRFlexEnv()
    env.reset(seed=0)
    action = np.zeros(N_ACTIONS)
    action[3 * panel + 1] = 1.0
    outputs, states = run_until_end(env, action)
    assert outputs[-1][2:4] == (True, False)
    assert outputs[-1][4]["failure"] == Failure.TIP_RANGE
    tips = [abs(state.qf[panel, 1]) for state in states]
    assert max(tips[:-1]) <= 1.0 < tips[-1]
    assert all(output[4]["failure"] == Failure.NONE and output[2] is False for output in outputs[:-1])


def test_observation_out_of_range_terminates():
    """Thrust off the path ends the episode when a field leaves its bound; the observation returned lies on it."""
    env = SFFRFlexEnv(overrides=["limits.position=0.05"])
    env.reset(seed=0)
    action = np.zeros(N_ACTIONS)
    action[7] = -1.0
    outputs, states = run_until_end(env, action)
    obs, _, terminated, _, info = outputs[-1]
    assert terminated and info["failure"] == Failure.OUT_OF_RANGE
    assert max(np.abs(output[0][env.fields["base_error"].slice]).max() for output in outputs[:-1]) <= 0.05
    assert obs[env.fields["base_error"].slice][1] == 0.05
    path = env.params.path
    desired = path.radius * (1.0 - np.cos(path.speed / path.radius * env.time))
    assert desired - states[-2].q[1] < 0.05 < desired - states[-1].q[1]
    assert env.observation_space.contains(obs)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_observation_on_its_bound_is_in_range(params, sign):
    """Any number next to its bound, on the far side, ends the episode and is put back on it; others stay."""
    task = make_task_model(params.with_overrides(*BASE_ALONE))
    obs, p = sign * task.bound, np.zeros(3)
    assert status_of(task, p, p, None, obs) == RUNNING
    np.testing.assert_array_equal(obs, sign * task.bound)
    for k in range(len(obs)):
        obs = 0.5 * sign * task.bound
        obs[k] = np.nextafter(sign * task.bound[k], sign * np.inf)
        assert status_of(task, p, p, None, obs) == Failure.OUT_OF_RANGE
        np.testing.assert_array_equal(obs, sign * task.bound * np.where(np.arange(len(obs)) == k, 1.0, 0.5))


@pytest.mark.parametrize(("least", "ends"), [(0.862, False), (0.865, True), (0.9, True)])
def test_singular_arm_terminates(least, ends):
    """The least |sin| of the elbows counts: that of arm 2 starts at |sin 2.1| = 0.863, that of arm 1 at 0.872."""
    env = SFFRFlexEnv(overrides=[f"limits.arm_singularity={least}"])
    env.reset(seed=0)
    _, _, terminated, _, info = env.step(np.zeros(N_ACTIONS))
    assert (terminated, info["failure"]) == (ends, Failure.ARM_SINGULAR if ends else Failure.NONE)


def test_nothing_terminates_where_a_turned_object_is_held_off_its_middle():
    """Gaps are from the grasp points, wherever these lie in the object's own axes."""
    env = SFFRFlexEnv(params=grasping_params(THREE_ARMS, arms=3, turned=0.4))
    env.reset(seed=0)
    for _ in range(3):
        *_, terminated, _, info = env.step(np.zeros(env.action_space.shape))
        assert not terminated and info["failure"] == Failure.NONE


@pytest.mark.parametrize(("gap", "ends"), [(0.8e-3, False), (1.3e-3, True)])
@pytest.mark.parametrize("axis", [0, 1])
def test_lost_grasp_terminates(gap, ends, axis):
    """An object pulled out of the grippers by more than the limit of 1 mm is lost."""
    env = SFFRFlexEnv()
    env.reset(seed=0)
    state = env.get_state()
    state["batch"].p[0, -3 + axis] += gap
    env.set_state(state)
    _, _, terminated, _, info = env.step(np.zeros(N_ACTIONS))
    assert (terminated, info["failure"]) == (ends, Failure.GRASP_LOST if ends else Failure.NONE)


@pytest.mark.parametrize(("rate", "speed"), [(1e3, 0.0), (20.0, 9e5)])
def test_overflow_ends_with_a_reason_and_without_nan(rate, speed):
    """What blows up, by itself or from a state restored, ends with a reason, and every number returned is finite."""
    env = SFFRFlexEnv(overrides=[f"simulation.baumgarte={rate}"])  # too fast for the steps beyond 500 / s
    env.reset(seed=0)
    state = env.get_state()
    state["batch"].v[0, 3] += speed
    env.set_state(state)
    with np.errstate(all="ignore"):  # it overflows, inside; numpy sees it where the kernels are not compiled
        outputs, _ = run_until_end(env, np.zeros(N_ACTIONS))
        assert outputs[-1][2] and outputs[-1][4]["failure"] != Failure.NONE
        outputs += rollout(env, np.zeros((200, N_ACTIONS)))  # whoever steps on gets no NaN either
    assert outputs[-1][4]["failure"] == Failure.NOT_FINITE
    assert_healthy(env, outputs)
    assert np.isfinite(env.positions).all() and np.isfinite(env.velocities).all()


def test_a_state_whose_energy_overflows_ends_the_episode():
    """Piezos of billions of newtons on a panel of nothing: finite states whose squares are not."""
    panel = ["panel.mass=1.0e-6", "panel.E=1.0e+13", "panel.EI=1.0e+6", "panel.bending_cut=1.0e+9"]
    piezo = ["actuators.piezo.force=1.0e+9", "actuators.piezo.moment=1.0e+9", "simulation.max_step=1.0e-5"]
    env = SFFRFlexEnv(overrides=[*panel, *piezo, "panel.axial_cut=1.0e+9"])
    env.reset(seed=0)
    with np.errstate(all="ignore"):
        outputs = rollout(env, np.ones((50, N_ACTIONS)))
    assert_healthy(env, outputs)
    assert outputs[-1][2]

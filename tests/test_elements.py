"""Panels of several elements in the closed loop: the same through every interface, and what the mode cuts leave out."""

import warnings

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.rollout import STRIDE, rollout
from sffr_gym.config.params import load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.model import pack
from sffr_gym.task.metrics import measure

FAST = ["control.period=5.0e-4", "simulation.max_step=5.0e-4"]
ALL_BENDING = "panel.bending_cut=1.0e+9"
MANY_BENDING = "panel.bending_cut=560"  # all that a law sampled every 0.5 ms can damp: 8 of 8 and 15 of 16


def circle(*overrides):
    """Measures of AHSC's full circle."""
    env = SFFRFlexEnv("nominal", overrides=list(overrides))
    trajectory = rollout(env, make_policy("ahsc", env), 0)
    return measure(trajectory.signals, trajectory.period, trajectory.failure)


@pytest.mark.parametrize("elements", [2, 4, 8])
def test_batch_environment_and_compiled_loop_agree(elements):
    """Bit for bit, with observations of the paper's coordinates of the tip whatever the elements."""
    overrides, ticks = [f"panel.elements={elements}"], 50
    env = SFFRFlexEnv("excited", overrides=overrides)
    batch = SFFRFlexVectorEnv(num_envs=2, scenario="excited", overrides=overrides)
    policy, policies = make_policy("ahsc", env), make_policy("ahsc", batch)
    obs, _ = env.reset(seed=5)
    rows, _ = batch.reset(seed=[5, 6])
    assert env.observation_space.shape == SFFRFlexEnv().observation_space.shape
    for _ in range(ticks):
        np.testing.assert_array_equal(rows[0], obs)
        obs, *_ = env.step(policy(obs))
        rows, *_ = batch.step(policies(rows))
    trajectory = rollout(SFFRFlexEnv("excited", overrides=overrides), make_policy("ahsc", env), 5)
    np.testing.assert_array_equal(trajectory.obs[ticks // STRIDE], obs)


@pytest.mark.parametrize("elements", [2, 4, 8])
def test_more_elements_keep_the_task_and_the_law(elements):
    """A finer panel under the law of the one-element model: tracking within 1 %, vibration within 5 %."""
    coarse, fine = circle(), circle(f"panel.elements={elements}")
    assert fine["failed"] == 0.0
    assert fine["track_rmse"] == pytest.approx(coarse["track_rmse"], rel=0.01)
    assert fine["vibration"] == pytest.approx(coarse["vibration"], rel=0.05)
    assert fine["vibration"] != coarse["vibration"]


def test_elements_converge():
    """Eight elements differ from four far less than four from one."""
    one, four, eight = (circle(f"panel.elements={count}")["vibration"] for count in (1, 4, 8))
    assert abs(eight - four) < 0.1 * abs(four - one)


def test_default_step_suffices_for_eight_elements():
    coarse, fine = (circle("panel.elements=8", f"simulation.max_step={step}") for step in (2.0e-3, 5.0e-4))
    for name in ("track_rmse", "vibration", "tip_max"):
        assert coarse[name] == pytest.approx(fine[name], rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("elements", [4, 8])
def test_what_the_cuts_leave_out(elements):
    """At 0.5 ms the law can damp far more bending modes: those above the default cut change the vibration by 1 %.

    The axial modes above theirs change nothing that could be seen.
    """
    fast = [f"panel.elements={elements}", *FAST]
    cut, bending, everything = (
        circle(*fast, *more) for more in ([], [MANY_BENDING], [MANY_BENDING, "panel.axial_cut=1e6"])
    )
    assert cut["track_rmse"] == pytest.approx(bending["track_rmse"], rel=5e-4)
    assert cut["vibration"] == pytest.approx(bending["vibration"], rel=0.011)
    assert cut["vibration"] != bending["vibration"]
    for name in ("track_rmse", "vibration", "tip_max"):
        assert everything[name] == pytest.approx(bending[name], rel=1e-6)


def test_defaults_cut_no_mode_of_one_element_and_keep_the_step():
    models = {count: pack(load_params().with_overrides(f"panel.elements={count}")) for count in (1, 4, 8)}
    assert {count: model.omega2.shape[1] - model.n_axial for count, model in models.items()} == {1: 2, 4: 5, 8: 6}
    assert {count: model.n_axial for count, model in models.items()} == {1: 1, 4: 2, 8: 2}
    assert {model.longest_step for model in models.values()} == {2.0e-3}


def test_the_law_keeps_the_papers_one_element_model():
    params = load_params()
    one, eight = (make_policy("hsc", params.with_overrides(f"panel.elements={n}")).law.suppression for n in (1, 8))
    for name, value in one._asdict().items():
        np.testing.assert_array_equal(getattr(eight, name), value)


@pytest.mark.parametrize(
    "overrides",
    [["panel.elements=8", ALL_BENDING], ["suppression.coordinates=all", "panel.strain_rate_damping=0"]],
    ids=["bending modes of a light tip", "undamped axial mode"],
)
def test_an_unstable_law_is_announced_and_fails(overrides):
    env = SFFRFlexEnv("nominal", overrides=overrides)
    with pytest.warns(UserWarning, match=r"held for 0.002 s.* grow .* shorten control.period"):
        policy = make_policy("hsc", env)
    trajectory = rollout(env, policy, 0)
    assert trajectory.failure


def test_no_warning_without_damping_panels_or_cause():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make_policy("none", load_params().with_overrides("panel.elements=8", ALL_BENDING))
        make_policy("hsc", load_params().with_overrides("panel.elements=8"))
        make_policy("hsc", load_params().with_overrides("panel.mounts=[]"))

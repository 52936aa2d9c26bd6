"""The start follows the path: who changes the path's speed or heading starts with it, unless rates are given."""

import numpy as np
import pytest
import yaml

from sffr_gym import Simulator, load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.kinematics import arm_points
from sffr_gym.physics.monolithic import constraint_jacobian
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.reference import desired, path_reference
from sffr_gym.task.scenario import load_scenario

AT_REST = "initial.qd=[0, 0, 0, 0, 0, 0, 0, 0, 0]"
TANGENT = "path.heading=tangent"
RATES = ("base_error_rate", "yaw_error_rate", "tip_error_rate", "object_error_rate", "object_angle_error_rate")


def start_of(params):
    """Return simulator and state at the start."""
    simulator = Simulator(params)
    return simulator, simulator.initial_state()


@pytest.mark.parametrize("changes", [["path.speed=2.0"], ["path={speed: 2.0}"], ["initial.qd=", "path.speed=2.0"]])
def test_an_overridden_speed_is_that_of_the_start(params, changes):
    """Base, joints and object move as one at the path's speed, to the last bit as if the rates had been given."""
    _, state = start_of(params.with_overrides(*changes))
    _, given = start_of(params.with_overrides("path.speed=2.0", "initial.qd=[2, 0, 0, 0, 0, 0, 0, 0, 0]"))
    assert state.qd[0] == 2.0 and np.abs(state.qd[1:]).max() < 1e-14
    for name in ("q", "qd", "qf", "qfd", "obj", "objd"):
        np.testing.assert_array_equal(getattr(state, name), getattr(given, name))


def test_a_file_with_another_speed_starts_at_it(params, tmp_path):
    """As an override does; one that gives rates as well keeps them."""
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump({"path": {"speed": 0.5}}))
    assert load_params(file) == params.with_overrides("path.speed=0.5")
    assert load_params(file).initial.qd is None
    file.write_text(yaml.safe_dump({"path": {"speed": 0.5}, "initial": {"qd": list(params.initial.qd)}}))
    assert load_params(file).initial.qd == params.initial.qd


@pytest.mark.parametrize(
    ("changes", "x"),
    [
        (["path.speed=2.0", AT_REST], 0.0),
        ([AT_REST, "path.speed=2.0"], 0.0),
        (["path.speed=2.0", "initial.qd.0=0.85"], 0.85),
        (["path.radius=30"], 0.85),
        (["panel.EI=25"], 0.85),
    ],
)
def test_given_rates_stay(params, changes, x):
    """Also those that happen to be the shipped ones, and where the path's start stays what it was."""
    changed = params.with_overrides(*changes)
    assert changed.initial.qd == (x, *[0.0] * 8)


def test_a_start_that_is_not_the_paths_stays_what_it_is(params):
    """Who put the robot at rest and then changes the speed still has it at rest."""
    resting = params.with_overrides(AT_REST)
    assert resting.with_overrides("path.speed=2.0").initial == resting.initial


@pytest.mark.parametrize(
    "changes", [[TANGENT], [TANGENT, "path.speed=0.5"], [TANGENT, "initial.q.2=0.7"], [TANGENT, "path.radius=5"]]
)
def test_a_tangent_path_is_begun_turning(params, changes):
    """Robot and object turn as one about the object: every rate of an error is zero, and so are the joints'."""
    changed = params.with_overrides(*changes)
    env = SFFRFlexEnv(params=changed)
    obs, _ = env.reset(seed=0)
    for name in RATES:
        np.testing.assert_allclose(obs[env.fields[name].slice], 0.0, rtol=0, atol=1e-13)
    simulator, state = start_of(changed)
    assert state.qd[2] == changed.path.speed / changed.path.radius
    np.testing.assert_allclose(state.qd[3:], 0.0, rtol=0, atol=1e-13)
    J, _ = constraint_jacobian(simulator.model, state.q, state.qd, state.obj)
    np.testing.assert_allclose(J @ np.concatenate([state.qd, state.objd]), 0.0, atol=1e-13)


def test_without_an_object_the_base_follows_the_path(params):
    """Whose reference it then is."""
    free = params.with_overrides("object=null", TANGENT, "path.speed=0.5")
    _, state = start_of(free)
    np.testing.assert_array_equal(state.qd, [0.5, 0.0, 0.5 / 15.0, *[0.0] * 6])


def test_a_drawn_speed_of_a_figure_eight_is_begun_turning():
    """Robot and object leave as the faster path does, whose heading already turns at the start."""
    params = load_params().with_overrides("path.kind=figure-eight", "path.speed=0.7", TANGENT)
    known = nominal(params)
    episode = draw(load_scenario("fast"), known, np.random.default_rng(3))
    want, begun = desired(episode.reference, 0.0), params.path.start[2]
    np.testing.assert_allclose(episode.v[known.model.at.object :], [want.xd, want.yd, want.turn], rtol=0, atol=1e-12)
    assert episode.v[2] == pytest.approx(want.turn, abs=1e-12)
    assert abs(want.turn - begun) > 1e-3 and abs(begun) > 1e-3


def test_a_drawn_speed_leaves_from_the_overridden_one():
    """`fast` on a robot of another speed starts at the drawn speed all the same."""
    params = load_params().with_overrides("path.speed=0.7", TANGENT)
    known = nominal(params)
    episode = draw(load_scenario("fast"), known, np.random.default_rng(3))
    speed = episode.drawn["path_speed_m_s"]
    want = desired(path_reference(episode.prior, known.model, episode.p), 0.0)
    np.testing.assert_allclose(episode.v[known.model.at.object :], [want.xd, want.yd, want.turn], rtol=0, atol=1e-12)
    assert want.xd == speed != 0.7
    tip = arm_points(known.model, episode.p[:9], episode.v[:9], 0)[1]
    assert np.isfinite(tip.x).all()

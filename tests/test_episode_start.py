"""Starts of episodes from drawn numbers: on any path, off it, with moving joints, and for many at once."""

import copy

import numpy as np
import pytest
from drawn import everything

from sffr_baselines.damping_env import SFFRFlexDampingVectorEnv
from sffr_gym import Simulator
from sffr_gym.config.params import load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.kinematics import perpendicular, rotation
from sffr_gym.physics.model import mode_slice
from sffr_gym.physics.monolithic import constraint_jacobian
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.episode_draws import drawn_names, episode_draws, sample, sample_pcg64
from sffr_gym.task.pcg64 import state_of
from sffr_gym.task.quasi_static import quasi_static_amplitudes
from sffr_gym.task.reference import Desired, desired, path_reference
from sffr_gym.task.scenario import Scenario, load_scenario, scenario_names

ELSEWHERE = "initial.q=[0.1, 0.2, 0.4, 0.6, 4.2, 5.6, 2.1, 0.4, 0.1]"
MOVING = "initial.qd=[0.8, 0.1, 0.05, 0.02, -0.03, 0.04, 0.01, 0.1, -0.2]"
PATHS = {
    "circle": ["path.heading=tangent"],
    "figure-eight": ["path.kind=figure-eight", "path.heading=tangent"],
    "waypoints": ["path.kind=waypoints", "path.points=[[3, 1], [6, -1], [9, 2]]", "path.heading=tangent"],
}


def user(**keys):
    """Return a scenario of a user."""
    return Scenario(name="mine", description="a test's", **keys)


def drawn_episode(params, scenario, seed=0):
    """Return an episode, and what all begin from."""
    known = nominal(params, scenario)
    return draw(scenario, known, np.random.default_rng(seed)), known


def slip(params, episode):
    """Return the largest velocity (m/s) of a gripper against the object, and its distance (m) from its grasp point."""
    simulator = Simulator(params)
    state = simulator.unflatten(0.0, episode.p, episode.v)
    J, _ = constraint_jacobian(simulator.model, state.q, state.qd, state.obj)
    return np.abs(J @ np.concatenate([state.qd, state.objd])).max(), simulator.constraint_drift(state)


@pytest.mark.parametrize("override", [[], [MOVING], [MOVING, ELSEWHERE]])
def test_an_offset_turns_how_the_object_moves_against_the_base(params, override):
    """Grasps stay closed and still; the base keeps its velocity, the joints their rates, the object its turn."""
    robot = params.with_overrides(*override)
    for seed in range(4):
        episode, known = drawn_episode(robot, user(offset_position=0.3, offset_angle=0.4), seed)
        at, angle = known.model.at, episode.drawn["offset_angle_rad"]
        assert max(slip(robot, episode)) < 1e-13
        np.testing.assert_array_equal(episode.v[: at.object], known.v[: at.object])
        assert episode.v[at.object + 2] == known.v[at.object + 2]

        def against_base(p, v, at=at):
            lever = p[at.object : at.object + 2] - p[:2]
            return lever, v[at.object : at.object + 2] - v[:2] - v[2] * perpendicular(lever)

        for turned, before in zip(against_base(episode.p, episode.v), against_base(known.p, known.v), strict=True):
            np.testing.assert_allclose(turned, rotation(angle) @ before, rtol=0, atol=1e-14)
        shift = episode.p[at.object : at.object + 2] - known.p[at.object : at.object + 2]
        assert np.hypot(*shift) == pytest.approx(episode.drawn["offset_m"], abs=1e-15)
        assert np.arctan2(*shift[::-1]) % (2 * np.pi) == pytest.approx(episode.drawn["offset_direction_rad"], abs=1e-12)


def test_an_offset_without_an_object_is_the_bases(params):
    """Which shifts by what was drawn and turns where it is, and keeps its velocity."""
    robot = params.with_overrides("object=null", MOVING, ELSEWHERE)
    episode, known = drawn_episode(robot, user(offset_position=0.3, offset_angle=0.4), 3)
    drawn, moved = episode.drawn, episode.p - known.p
    direction = np.array([np.cos(drawn["offset_direction_rad"]), np.sin(drawn["offset_direction_rad"])])
    np.testing.assert_allclose(moved[:3], [*drawn["offset_m"] * direction, drawn["offset_angle_rad"]], atol=1e-15)
    assert not moved[3:].any()
    np.testing.assert_array_equal(episode.v, known.v)


@pytest.mark.parametrize("kind", PATHS)
def test_a_drawn_speed_is_that_of_the_whole_path(params, kind):
    """The desired motion, the episode's length and the start are those of a robot whose path has that speed."""
    robot = params.with_overrides(*PATHS[kind], "initial.qfd=[0, 0, 0]")
    episode, known = drawn_episode(robot, user(speed=(0.5, 0.7)), 3)
    speed = episode.drawn["path_speed_m_s"]
    same = robot.with_overrides(f"path.speed={speed!r}")
    again, expected = drawn_episode(same, user())
    assert episode.ticks == again.ticks
    np.testing.assert_allclose(episode.p, again.p, rtol=0, atol=1e-14)
    wanted = path_reference(same, expected.model, expected.p)
    for t in (0.0, 2.0, 7.5, 19.0):
        for name, a, b in zip(Desired._fields, desired(episode.reference, t), desired(wanted, t), strict=True):
            assert a == pytest.approx(b, rel=1e-10, abs=1e-12), name
    want, at = desired(wanted, 0.0), known.model.at.object
    np.testing.assert_allclose(episode.v[at:], [want.xd, want.yd, want.turn], rtol=0, atol=1e-12)
    assert max(slip(robot, episode)) < 1e-13


@pytest.mark.parametrize("kind", ["circle", "figure-eight"])
def test_a_drawn_phase_starts_there_with_moving_joints(params, kind):
    """What was drawn moves robot and object as one: the motion of joints and object against the base stays."""
    robot = params.with_overrides(*PATHS[kind], MOVING)
    episode, known = drawn_episode(robot, user(random_phase=True), 1)
    at, want, start = known.model.at, desired(episode.reference, 0.0), robot.path.start
    assert episode.reference.phase == episode.drawn["path_phase_rad"]
    change = np.array([want.xd - start[0], want.yd - start[1], want.turn - start[2]])
    np.testing.assert_allclose(episode.v[at.object :] - known.v[at.object :], change, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(episode.v[3 : at.modes], known.v[3 : at.modes])
    assert max(slip(robot, episode)) < 1e-13


@pytest.mark.parametrize("kind", ["circle", "figure-eight"])
def test_panels_start_with_their_quasi_static_shape_and_its_rate(params, kind):
    """As they are at the drawn phase; added to what they have."""
    robot = params.with_overrides(f"path.kind={kind}", ELSEWHERE)
    episode, known = drawn_episode(robot, user(random_phase=True), 2)
    modes, reference = mode_slice(known.model), episode.reference
    shape, rate = quasi_static_amplitudes(known.model, reference, np.zeros(1))
    assert np.abs(shape).max() > 1e-5 and np.abs(rate).max() > 1e-7
    np.testing.assert_allclose(episode.p[modes] - known.p[modes], shape.ravel(), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(episode.v[modes] - known.v[modes], rate.ravel(), rtol=1e-9, atol=1e-15)


def test_a_drawn_plant_starts_at_the_drawn_speed_once(params):
    """Also where the start follows the path, since its speed was changed: `rough` and `varied` draw both."""
    robot = params.with_overrides("path.speed=0.7")
    assert robot.initial.qd is None
    episode, known = drawn_episode(robot, user(speed=(1.1, 1.2), plant={"panel_mass": (0.9, 0.95)}))
    speed = episode.drawn["path_speed_m_s"]
    np.testing.assert_allclose(episode.v[:3], [speed, 0.0, 0.0], rtol=0, atol=1e-14)
    np.testing.assert_allclose(episode.v[known.model.at.object :], [speed, 0.0, 0.0], rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", [*scenario_names(), "practice/mixed", "everything"])
def test_numbers_of_a_state_are_those_of_the_generator(params, name):
    """What kernels draw by a generator's state is what NumPy draws, and leaves the same state."""
    scenario = everything() if name == "everything" else load_scenario(name)
    robot = scenario.robot_of(params)
    known = nominal(robot, scenario)
    draws = episode_draws(scenario, robot, known.model, known.p, known.v, known.fields)
    count = len(drawn_names(scenario, draws, 2))
    assert count == len(draws.kinds) == len(draws.ends)
    rng = np.random.default_rng(11)
    state, expected, found = state_of(rng), np.zeros(count), np.zeros(count)
    for _ in range(3):
        sample(draws, rng, expected, 0, count)
        sample_pcg64(draws, state, found)
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(state, state_of(rng))


@pytest.mark.parametrize("generator", [np.random.PCG64, np.random.MT19937])
def test_many_start_as_each_would_alone(generator):
    """All that can be drawn without the plant, by any generator of NumPy's."""
    scenario = everything()
    together, alone = SFFRFlexVectorEnv(3, scenario=scenario), SFFRFlexEnv(scenario=scenario)
    together.np_random = [np.random.Generator(generator(seed)) for seed in range(3)]
    seen, infos = together.reset()
    for i in range(3):
        alone.np_random = np.random.Generator(generator(i))
        obs, info = alone.reset()
        np.testing.assert_array_equal(seen[i], obs)
        for name in info:
            np.testing.assert_array_equal(infos[name][i], info[name], err_msg=name)
        for array, own in zip(together._batch, alone._batch, strict=True):
            np.testing.assert_array_equal(array[i], own[0])
        assert together._ticks[i] == alone.ticks


@pytest.mark.parametrize("kind", [SFFRFlexVectorEnv, SFFRFlexDampingVectorEnv])
def test_copies_and_restored_states_begin_their_own_episodes(kind):
    """What draws episodes writes to the arrays that an environment has now."""
    env = kind(3, scenario="excited")
    env.reset(seed=1)
    twin, state = copy.deepcopy(env), env.get_state()
    first, _ = env.reset()
    before = env.get_state()["batch"].p
    np.testing.assert_array_equal(twin.reset()[0], first)
    np.testing.assert_array_equal(env._batch.p, before)
    env.set_state(state)
    np.testing.assert_array_equal(env.reset()[0], first)
    mask = np.array([False, True, False])
    again, _ = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal((again != first).any(axis=1), mask)


def test_a_scenario_that_is_changed_draws_its_own():
    """After one without and one with a plant, in a batch."""
    env = SFFRFlexVectorEnv(2, scenario="excited")
    env.reset(seed=1)
    for name in ("offset", "payload", "nominal", "noise", "excited"):
        seen, infos = env.reset(seed=5, options={"scenario": name})
        alone = SFFRFlexEnv(scenario=name)
        obs, info = alone.reset(seed=5)
        np.testing.assert_array_equal(seen[0], obs)
        drawn = {key for key in infos if key.startswith("drawn_")}
        assert drawn == {key for key in info if key.startswith("drawn_")}


def test_what_everything_draws_is_there():
    """The test's own scenario draws all that a scenario can without the plant."""
    params = load_params()
    known = nominal(params)
    draws = episode_draws(everything(), params, known.model, known.p, known.v, known.fields)
    assert set(draws.kinds.tolist()) == {0, 1, 2}
    assert draws.draws_speed == draws.draws_phase == draws.noisy == 1
    assert len(draws.modes) and len(draws.offset) and len(draws.moment) and draws.steps.max() >= 0

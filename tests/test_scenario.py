"""Scenarios: what each one draws, that it draws the same for the same seed, its length, and bad files."""

import gymnasium as gym
import numpy as np
import pytest
import scipy.linalg

from sffr_gym import ConfigError, Simulator
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.kinematics import arm_points, rotation
from sffr_gym.physics.monolithic import constraint_jacobian
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.scenario import load_scenario, scenario_names

ID = "SFFRFlex-v0"
SEEDS = range(40)
TABLE_IV = [0, 0, 0, 0.6, 4.2, 5.6, 2.1, np.pi / 7, np.pi / 36]


@pytest.fixture(scope="module")
def simulator():
    """Return the simulator of the case study."""
    return Simulator()


def starts(simulator, name, seeds=SEEDS):
    """Return the start states and the drawn values of a scenario's episodes."""
    found = []
    for seed in seeds:
        episode = draw(load_scenario(name), nominal(simulator.params), np.random.default_rng(seed))
        found.append((simulator.unflatten(0.0, episode.p, episode.v), episode.drawn))
    return found


def grasp_speed(simulator, state):
    """Return the largest velocity of a gripper relative to its grasp point [m/s]."""
    J, _ = constraint_jacobian(simulator.model, state.q, state.qd, state.obj)
    return np.abs(J @ np.concatenate([state.qd, state.objd])).max()


def test_nominal_is_table_iv_and_draws_nothing(simulator):
    """Every episode starts at Table IV, the object at rest in the grippers, and no random number is used."""
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    episode = draw(load_scenario("nominal"), nominal(simulator.params), rng)
    assert rng.bit_generator.state == before
    assert episode.drawn == {}
    state = simulator.unflatten(0.0, episode.p, episode.v)
    np.testing.assert_allclose(state.q, TABLE_IV, rtol=0, atol=1e-9)  # the grasps are closed by the digits given
    np.testing.assert_allclose(state.qd, [0.85] + [0.0] * 8, rtol=0, atol=1e-12)
    np.testing.assert_allclose(state.qf, 0.0, rtol=0, atol=0)
    np.testing.assert_allclose(state.qfd, [[0.0, -0.1, 0.0]] * 2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(state.objd, [0.85, 0.0, 0.0], rtol=0, atol=1e-12)
    assert simulator.constraint_drift(state) < 1e-14
    tips = [arm_points(simulator.model, state.q, state.qd, arm)[1].x for arm in (0, 1)]
    np.testing.assert_allclose(state.obj[:2], np.mean(tips, axis=0), rtol=0, atol=1e-14)


def test_excited_draws_amplitude_and_phase_of_each_mode(simulator):
    """Each panel vibrates in its clamped modes with the drawn tip amplitudes and phases; all else is Table IV."""
    panel = simulator.params.panel
    m, L, EI = panel.mass, panel.length, panel.EI
    M = m * np.array([[13 / 35, -11 / 210 * L], [-11 / 210 * L, L**2 / 105]])
    K = EI / L**3 * np.array([[12, -6 * L], [-6 * L, 4 * L**2]])
    squares, shapes = scipy.linalg.eigh(K, M)
    shapes = shapes / shapes[0]  # unit tip displacement
    tips, phases = [], []
    for state, drawn in starts(simulator, "excited"):
        for i in range(2):
            tip = [drawn[f"panel{i}_mode{mode}_tip_m"] for mode in (1, 2)]
            phase = [drawn[f"panel{i}_mode{mode}_phase_rad"] for mode in (1, 2)]
            np.testing.assert_allclose(state.qf[i], [0, *(shapes @ (tip * np.cos(phase)))], rtol=0, atol=1e-12)
            rate = shapes @ (-np.sqrt(squares) * tip * np.sin(phase))
            np.testing.assert_allclose(state.qfd[i], [0, *rate], rtol=0, atol=1e-12)
            energy = 0.5 * state.qfd[i, 1:] @ M @ state.qfd[i, 1:] + 0.5 * state.qf[i, 1:] @ K @ state.qf[i, 1:]
            stiffness = np.einsum("im,ij,jm->m", shapes, K, shapes)
            assert energy == pytest.approx(0.5 * stiffness @ np.square(tip), rel=1e-10)
            tips.append(tip)
            phases.append(phase)
        np.testing.assert_allclose(state.q, TABLE_IV, rtol=0, atol=1e-9)
        np.testing.assert_allclose(state.qd, [0.85] + [0.0] * 8, rtol=0, atol=1e-12)
    first, second = np.transpose(tips)
    assert 0.05 <= first.min() < 0.06 and 0.24 < first.max() <= 0.25
    assert 0.0 <= second.min() < 5e-4 and 9.5e-3 < second.max() <= 0.01
    for phase in np.transpose(phases):
        assert set(np.floor(phase / (np.pi / 2))) == {0, 1, 2, 3}, "a quarter of the phases is never drawn"
    assert len({*first}) == len(first), "panels and episodes differ"


def test_offset_moves_the_robot_as_one(simulator):
    """Robot and object start turned and shifted as one within 0.10 m and 0.05 rad, the grasps closed and at rest."""
    nominal = starts(simulator, "nominal", [0])[0][0]
    shifts, angles = [], []
    for state, drawn in starts(simulator, "offset"):
        angle = state.obj[2] - nominal.obj[2]
        shift = state.obj[:2] - nominal.obj[:2]
        np.testing.assert_allclose(
            state.q[:2] - state.obj[:2], rotation(angle) @ (nominal.q[:2] - nominal.obj[:2]), rtol=0, atol=1e-13
        )
        assert state.q[2] - nominal.q[2] == pytest.approx(angle, abs=1e-14)
        direction = drawn["offset_direction_rad"]
        np.testing.assert_allclose(
            shift, drawn["offset_m"] * np.array([np.cos(direction), np.sin(direction)]), rtol=0, atol=1e-14
        )
        assert angle == pytest.approx(drawn["offset_angle_rad"], abs=1e-14)
        for name in ("qd", "qf", "qfd", "objd"):
            np.testing.assert_allclose(getattr(state, name), getattr(nominal, name), rtol=0, atol=1e-15)
        np.testing.assert_array_equal(state.q[3:], nominal.q[3:])
        assert simulator.constraint_drift(state) < 1e-14
        assert grasp_speed(simulator, state) < 1e-14
        shifts.append(np.hypot(*shift))
        angles.append(angle)
    assert 0.09 < max(shifts) <= 0.10
    assert np.mean(np.square(shifts)) == pytest.approx(0.1**2 / 2, rel=0.2)  # uniform over the disc, 40 draws
    assert -0.05 <= min(angles) < -0.04 and 0.04 < max(angles) <= 0.05


def test_a_plant_is_drawn_with_its_numbers_or_with_its_faults():
    assert all(load_scenario(name).draws_plant for name in ("payload", "degraded", "weak"))
    assert not any(load_scenario(name).draws_plant for name in ("nominal", "noise", "truth", "patches"))


def test_offset_goes_to_all_sides(simulator):
    directions = [drawn["offset_direction_rad"] for _, drawn in starts(simulator, "offset")]
    assert set(np.floor(np.array(directions) / (np.pi / 2))) == {0, 1, 2, 3}


def test_offset_keeps_the_grasps_at_rest_for_a_turning_start(simulator):
    """A start that turns stays consistent when it is moved as one: the grippers keep the velocity of their points."""
    turning = Simulator(simulator.params.with_overrides("initial.qd=[0.85, 0, 0.2, 0, 0, 0, 0, 0, 0]"))
    assert grasp_speed(turning, starts(turning, "nominal", [0])[0][0]) < 1e-14
    assert max(grasp_speed(turning, state) for state, _ in starts(turning, "offset")) < 1e-14


def test_offset_is_what_the_policy_sees():
    """The object's error at the start is minus the drawn shift and turn."""
    env = SFFRFlexEnv("offset")
    obs, info = env.reset(seed=5)
    fields, direction = env.fields, info["drawn_offset_direction_rad"]
    shift = info["drawn_offset_m"] * np.array([np.cos(direction), np.sin(direction)])
    np.testing.assert_allclose(obs[fields["object_error"].slice], -shift, rtol=0, atol=1e-14)
    assert obs[fields["object_angle_error"].start] == pytest.approx(-info["drawn_offset_angle_rad"], abs=1e-14)
    assert np.abs(obs[fields["object_error_rate"].slice]).max() < 1e-14


@pytest.mark.parametrize("name", ["excited", "offset"])
def test_a_seed_is_an_episode(simulator, name):
    """The same seed gives the same start to the last bit, each other seed another one."""
    first, again = starts(simulator, name), starts(simulator, name)
    assert [state.q.tobytes() + state.qf.tobytes() + state.qfd.tobytes() for state, _ in first] == [
        state.q.tobytes() + state.qf.tobytes() + state.qfd.tobytes() for state, _ in again
    ]
    assert len({tuple(drawn.values()) for _, drawn in first}) == len(first)


def test_different_seeds_differ_and_unseeded_resets_go_on():
    """In the environment, each seed is an episode of its own, and resets without a seed draw on."""
    env = SFFRFlexEnv("excited")
    observations = [env.reset(seed=seed)[0] for seed in range(4)] + [env.reset()[0] for _ in range(3)]
    assert len({obs.tobytes() for obs in observations}) == len(observations)


@pytest.mark.parametrize("duration", [0.010, 0.009])
@pytest.mark.parametrize("made", [True, False])
def test_truncates_when_the_scenarios_time_is_over(user_scenario, duration, made):
    """A user's scenario of five control periods, or of its last one begun, truncates at the fifth step."""
    file = user_scenario(duration=duration)
    env = gym.make(ID, scenario=file) if made else SFFRFlexEnv(file)
    for _ in range(2):
        env.reset(seed=0)
        ends = [env.step(np.zeros(15))[2:4] for _ in range(5)]
        assert ends == [(False, False)] * 4 + [(False, True)]


def test_max_episode_steps_shortens_an_episode():
    """Gymnasium's own limit truncates before the scenario does."""
    env = gym.make(ID, max_episode_steps=3)
    env.reset(seed=0)
    assert [env.step(np.zeros(15))[3] for _ in range(3)] == [False, False, True]


@pytest.mark.parametrize(
    ("override", "ticks"), [("path.speed=0.85", 55_440), ("path.speed=0.6", 78_540), ("control.period=5.0e-4", 221_760)]
)
def test_an_episode_is_once_around(override, ticks):
    """Without a duration the episode lasts the circle's period, and the registered time limit does not cut it."""
    env = gym.make(ID, overrides=[override])
    scenario, params = env.unwrapped.scenario, env.unwrapped.params
    assert scenario.ticks(params) == ticks
    assert scenario.ticks(params) == np.ceil(2 * np.pi * 15.0 / params.path.speed / params.control.period)
    assert env.spec.max_episode_steps is None or env.spec.max_episode_steps >= ticks


def test_a_users_file_sets_what_is_drawn(simulator, user_scenario):
    """Every key of a user's file changes what it names."""
    file = user_scenario(
        duration=3.0, panel_modes=[{"mode": 2, "amplitude": [0.02, 0.02]}], offset_position=0.5, offset_angle=0.0
    )
    scenario = load_scenario(file)
    assert (scenario.name, scenario.ticks(simulator.params)) == ("mine", 1500)
    for state, drawn in starts(simulator, file, range(5)):
        assert drawn["panel0_mode2_tip_m"] == drawn["panel1_mode2_tip_m"] == 0.02
        assert "panel0_mode1_tip_m" not in drawn
        assert drawn["offset_angle_rad"] == state.q[2] == 0.0
    assert max(drawn["offset_m"] for _, drawn in starts(simulator, file)) > 0.3


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"durations": 1.0}, r"mine\.yaml:\d+: durations: unknown key; did you mean 'duration'"),
        ({"panel_modes": [{"mode": 1, "amplitud": [0, 1]}]}, "did you mean 'amplitude'"),
        (
            {"panel_modes": [{"mode": 1, "amplitude": [0.2, 0.1]}]},
            r"mine\.yaml:\d+: panel_modes\.0\.amplitude = \[0\.2, 0\.1\]: .* 0 <= lower <= upper",
        ),
        ({"panel_modes": [{"mode": 1, "amplitude": [-0.2, 0.1]}]}, "0 <= lower <= upper"),
        ({"panel_modes": [{"mode": 1, "amplitude": [0.1]}]}, "amplitude"),
        ({"panel_modes": [{"mode": 0, "amplitude": [0, 0.1]}]}, "panel_modes.0.mode = 0: must be at least 1"),
        ({"duration": 0}, "duration = 0: must be at least 1e-06"),
        ({"duration": "long"}, "duration = 'long': must be a number"),
        ({"offset_position": -0.1}, "offset_position = -0.1: must be at least 0"),
        ({"speed": [1.2, 0.6]}, r"mine\.yaml:\d+: speed = \[1\.2, 0\.6\]: .* 0\.01 <= lower <= upper <= 10"),
        ({"speed": [0.0, 0.6]}, "speed = .* 0.01 <= lower"),
        ({"plant": {"links_mass": [0.7, 1.3]}}, "plant.links_mass: unknown key; did you mean 'link_mass'"),
        ({"plant": {"object": [1.0, 101.0]}}, "plant.object = .* 0.01 <= lower <= upper <= 100"),
        ({"plant": {"link_mass": 1.1}}, r"plant.link_mass = 1\.1: must be a list \(.*each link"),
        ({"sensors": {"position": -1.0e-4}}, r"sensors.position = -0\.0001: must be at least 0 .*\[m\]"),
        ({"sensors": {"delay": 2}}, "sensors.delay = 2: must be at most 1"),
        ({"faults": [{"actuators": "thrusters", "remaining": 0.5}]}, "must be 'piezo', 'thruster' or 'joint'"),
        ({"faults": [{"actuators": "joint", "remaining": 1.5}]}, "faults.0.remaining = 1.5: must be at most 1"),
        ({"faults": [{"actuators": "joint"}]}, "faults.0.remaining: missing"),
        ({"impulses": {"count": 9, "linear": 1.0, "angular": 1.0}}, "impulses.count = 9: must be at most 8"),
        ({"impulses": {"count": 0, "linear": 1.0, "angular": 1.0}}, "impulses.count = 0: must be at least 1"),
        ({"name": None}, "name"),
    ],
)
def test_a_bad_file_is_rejected(user_scenario, keys, message):
    """A wrong key, type or interval raises with the place and what is allowed."""
    with pytest.raises(ConfigError, match=message):
        load_scenario(user_scenario(**keys))


def test_unknown_names_are_rejected():
    """A scenario that does not exist raises with the nearest one."""
    with pytest.raises(ConfigError, match="did you mean 'excited'"):
        load_scenario("exited")
    with pytest.raises(ConfigError, match="no such file"):
        load_scenario("nowhere/mine.yaml")


def test_training_scenarios_are_no_part_of_the_suite():
    """A name in a folder below is found, and nothing is scored on it unless it is named."""
    assert load_scenario("practice/mixed").name == "mixed"
    assert not any("mixed" in name or "training" in name for name in scenario_names())


@pytest.mark.parametrize("override", ["panel.elements=1", "panel.mass=1.0e-6"])
def test_a_mode_that_the_panel_lacks_is_rejected(user_scenario, override):
    """A bending mode beyond those of the panel's elements, or above its mode cut, is an error of the configuration."""
    with pytest.raises(ConfigError, match="mode"):
        SFFRFlexEnv(user_scenario(panel_modes=[{"mode": 3, "amplitude": [0, 0.1]}]), overrides=[override]).reset(seed=0)


def test_more_elements_have_more_modes(user_scenario):
    """With two elements the third bending mode exists and shows at the tip."""
    env = SFFRFlexEnv(
        user_scenario(panel_modes=[{"mode": 3, "amplitude": [0.01, 0.01]}]), overrides=["panel.elements=2"]
    )
    _, info = env.reset(seed=1)
    state, phase = env.state(), info["drawn_panel0_mode3_phase_rad"]
    assert state.qf[0, -2] == pytest.approx(0.01 * np.cos(phase), rel=1e-9)

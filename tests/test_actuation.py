"""Actuators that are not ideal: commands in steps, thrusters that are on or off, lags; by closed forms."""

import copy

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_baselines.rollout import rollout
from sffr_gym import ConfigError, SFFRFlexEnv, SFFRFlexVectorEnv, load_params
from sffr_gym.physics.actuators import actuate, actuator_state, pack_actuators, state_size
from sffr_gym.physics.linearization import command_labels
from sffr_gym.physics.model import pack
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.status import Failure

ON_OFF = "actuators.thrusters=on-off"
X, Y, YAW = 6, 7, 8  # thruster axes of a command
DRAWS = {
    "on_off": 0.5, "minimum_on_time": [0.004, 0.02], "lag": {"piezo": [0.001, 0.01], "joint": [0.0, 0.004]},
    "quantisation": {"piezo": [0.01, 0.1], "thruster_torque": [0.0, 0.01], "joint": [0.001, 0.01]},
}  # fmt: skip


class Held:
    """Actuators of a robot, commanded period by period."""

    def __init__(self, *overrides):
        params = load_params().with_overrides(*overrides)
        self.actuators = pack_actuators(params, pack(params))
        self.n_u = len(self.actuators.limit)
        self.numbers = np.zeros(state_size(self.n_u))
        self.asked, self.applied = np.zeros(self.n_u), np.zeros(self.n_u)

    def __call__(self, command):
        """Return what is given of a command, or of one that is 0 but for an index and a value."""
        if isinstance(command, tuple):
            index, value = command
            command = np.zeros(self.n_u)
            command[index] = value
        actuate(self.actuators, command, actuator_state(self.actuators, self.numbers), self.asked, self.applied)
        return self.applied.copy()


def test_ideal_actuators_give_what_is_asked():
    """Within their limits, to the last bit, and remember nothing."""
    held = Held()
    command = np.random.default_rng(0).uniform(-2.0, 2.0, held.n_u) * held.actuators.limit
    np.testing.assert_array_equal(held(command), np.clip(command, -held.actuators.limit, held.actuators.limit))
    assert held.actuators.ideal and not held.numbers.any()


def test_groups_of_a_command_lie_where_their_names_say():
    """The index map of saturated parts against the names of the command's numbers."""
    params = load_params()
    model = pack(params)
    actuators = pack_actuators(params, model)
    names, at = [label.name for label in command_labels(params, model, actuators)], actuators.at
    assert all("_piezo" in name for name in names[: at.thrust])
    assert names[at.thrust : at.joints] == ["thrust_x", "thrust_y", "thrust_yaw"]
    assert all("_torque" in name for name in names[at.joints :]) and at.end == len(names)


def test_commands_come_in_steps():
    """To the nearest one, of each group its own; what lies beyond the limit is the limit, whatever the step."""
    steps = "{piezo: 3.0, thruster_force: 0.4, thruster_torque: 0.7, joint: 0.25}"
    held = Held(f"actuators.quantisation={steps}")
    quantum = np.array([3.0] * 6 + [0.4, 0.4, 0.7] + [0.25] * 6)
    command = np.random.default_rng(1).uniform(-0.9, 0.9, held.n_u) * held.actuators.limit
    given = held(command)
    assert (np.abs(given - command) <= quantum / 2.0 + 1e-12).all() and (given != command).all()
    np.testing.assert_allclose(given / quantum, np.round(given / quantum), atol=1e-9)
    assert held((0, 1e3))[0] == 200.0 and held((YAW, -1e3))[YAW] == -100.0  # no multiples of their steps
    assert held((X, 0.19))[X] == 0.0 and held((X, 0.21))[X] == 0.4


@pytest.mark.parametrize("constant", [1.0e-3, 0.05, 3.0])
def test_lag_is_that_of_first_order_on_average_over_each_period(constant):
    """A step: what was given adds up to the integral of 1 - exp(-t / c), from the first period on."""
    held, T = Held(f"actuators.lag={{piezo: {constant}, thruster: 0.0, joint: 0.2}}"), 2.0e-3
    given = np.array([held((0, 100.0))[0] for _ in range(200)])
    t = T * np.arange(1, 201)
    np.testing.assert_allclose(np.cumsum(given) * T, 100.0 * (t + constant * np.expm1(-t / constant)), rtol=1e-12)
    assert held((X, 5.0))[X] == 5.0  # no lag of its own
    assert 0.0 < held((9, 1.0))[9] < 0.01


@pytest.mark.parametrize("axis", [X, Y, YAW])
def test_a_lagging_actuator_dies_away(axis):
    """Nothing is asked any more: what is left falls by exp(-T / c) a period."""
    held = Held("actuators.lag={piezo: 0.0, thruster: 0.02, joint: 0.0}")
    for _ in range(1000):
        held((axis, 40.0))
    given = np.array([held((axis, 0.0))[axis] for _ in range(50)])
    np.testing.assert_allclose(given[1:] / given[:-1], np.exp(-0.1), rtol=1e-12)
    assert given[0] == pytest.approx(40.0 * (1.0 - np.exp(-0.1)) / 0.1, rel=1e-12)


def pulses(thrust):
    """Lengths of the pulses of a signal that is 0 or not, and of the pauses between them, but for the last ones."""
    edges = np.flatnonzero(np.diff((np.asarray(thrust) != 0.0).astype(int)))
    lengths = np.diff(edges)
    begins = 0 if thrust[edges[0]] == 0.0 else 1
    return lengths[begins::2], lengths[1 - begins :: 2]


FINE = ["control.period=1.0e-4", "simulation.max_step=1.0e-4", "actuators.modulator.time_constant=0.1"]


@pytest.mark.parametrize("part", [0.15, 0.3, 0.5, 0.8, -0.6])
def test_pulses_are_as_long_as_those_of_the_modulator_in_continuous_time(part):
    """Width and pause under a constant command: times in which the filter goes from one level of the trigger to the
    other, of Wie's textbook, but for four samples of 0.1 ms: the trigger sees a level only at the next one."""
    held = Held(ON_OFF, *FINE, "actuators.modulator.minimum_on_time=0.0")
    gain, opens, shuts, c = 4.5, 0.45, 0.15, 0.1
    thrust = [held((X, part * 100.0))[X] for _ in range(8000)]
    assert set(thrust) == {0.0, np.sign(part) * 100.0}
    on, off = pulses(thrust)
    r = abs(part)
    width = -c * np.log((shuts - gain * (r - 1.0)) / (opens - gain * (r - 1.0)))
    pause = -c * np.log((gain * r - opens) / (gain * r - shuts))
    np.testing.assert_allclose(on * 1.0e-4, width, atol=4.0e-4)
    np.testing.assert_allclose(off * 1.0e-4, pause, atol=4.0e-4)


def test_small_commands_open_no_thruster_and_large_ones_leave_it_open():
    """Below opens / gain = 0.1 the trigger is not reached; from 1 + shuts / gain - 1 on it does not shut."""
    for part, expected in ((0.099, {0.0}), (1.0, {100.0})):
        held = Held(ON_OFF)
        assert {held((X, part * 100.0))[X] for _ in range(3000)} - {0.0} == expected - {0.0}
        assert held((X, part * 100.0))[X] in expected


def test_a_thruster_stays_open_for_the_minimum_impulse():
    """Whatever is asked meanwhile: 30 ms at 2 ms are 15 periods, of each axis by itself and with its own sign."""
    held = Held(ON_OFF, "actuators.modulator.minimum_on_time=0.03", "actuators.modulator.time_constant=0.0")
    command = np.zeros(held.n_u)
    command[X], command[YAW] = 100.0, -100.0
    first = held(command)
    assert (first[X], first[Y], first[YAW]) == (100.0, 0.0, -100.0)
    given = np.array([held(-command) for _ in range(14)])
    assert (given[:, X] == 100.0).all() and (given[:, YAW] == -100.0).all()
    then = held(-command)
    assert (then[X], then[YAW]) == (-100.0, 100.0)


@pytest.mark.parametrize(("key", "value", "right"), [("shuts", 0.5, "opens"), ("gain", 0.4, "opens")])
def test_a_trigger_that_chatters_or_never_opens_is_refused(key, value, right):
    with pytest.raises(ConfigError, match=rf"modulator\.{key} = {value}: must be .* than {right}"):
        load_params().with_overrides(f"actuators.modulator.{key}={value}")


def test_saturation_is_of_what_was_asked():
    """A thruster that is on is not at its limit unless more is asked; one that lags behind a full command is."""
    env = SFFRFlexEnv({"name": "still", "description": "", "duration": 1.0}, overrides=[ON_OFF])
    env.reset(seed=0)
    action = np.zeros(15)
    action[X] = 0.5
    infos = [env.step(action)[-1] for _ in range(40)]
    assert any(info["applied"][X] == 100.0 for info in infos)
    assert not any(info["thruster_saturated"] for info in infos)
    action[0], action[X] = 1.0, 1.5
    info = env.step(action)[-1]
    assert (info["thruster_saturated"], info["piezo_saturated"]) == (1 / 3, 1 / 6)


@pytest.mark.parametrize(
    ("many", "one"), [(SFFRFlexVectorEnv, SFFRFlexEnv), (SFFRFlexDampingVectorEnv, SFFRFlexDampingEnv)]
)
@pytest.mark.parametrize("offset", [0, 9])
def test_environments_whose_actuators_differ_are_each_of_them_alone(many, one, offset, user_scenario):
    """On-off beside continuous thrusters, lags, steps and sensors' steps, in lanes and beyond the last full group."""
    scenario = user_scenario(
        duration=1.0, plant=DRAWS, offset_position=0.02,
        sensors={"quantisation": {"position": [1e-5, 1e-4], "rate": [1e-4, 1e-3]}, "delay": 0.5},
    )  # fmt: skip
    together = many(11, scenario=scenario)
    inputs = np.random.default_rng(0).uniform(-0.3, 0.3, (12, *together.action_space.shape))
    first = together.reset(seed=5)[0]
    kinds = together.get_attr("plant_task")
    assert {task.actuators.modulator.active for task in kinds[:8]} == {0.0, 1.0}
    found = [together.step(each)[:2] for each in inputs]
    for i in (offset, offset + 1):
        alone = one(scenario=scenario)
        np.testing.assert_array_equal(alone.reset(seed=5 + i)[0], first[i])
        for (obs, reward), each in zip(found, inputs, strict=True):
            expected = alone.step(each[i])
            np.testing.assert_array_equal(obs[i], expected[0])
            assert reward[i] == expected[1]
        kept = together.get_state()["batch"].actuation[i]
        np.testing.assert_array_equal(kept, alone.get_state()["batch"].actuation[0])
        assert kept.any()


def test_a_state_keeps_valves_and_lags(user_scenario):
    """In the middle of a pulse: the copy goes on as the environment does."""
    env = SFFRFlexEnv(user_scenario(plant=DRAWS | {"on_off": 1.0}), overrides=["actuators.thruster_force=10"])
    env.reset(seed=1)
    action = np.full(15, 0.4)
    for _ in range(7):
        env.step(action)
    state = env.get_state()
    assert state["batch"].actuation.any()
    other = SFFRFlexEnv(user_scenario(plant=DRAWS | {"on_off": 1.0}), overrides=["actuators.thruster_force=10"])
    other.set_state(state)
    for _ in range(20):
        left, right = env.step(action), other.step(action)
        np.testing.assert_array_equal(left[0], right[0])
        np.testing.assert_array_equal(left[-1]["applied"], right[-1]["applied"])


def test_a_period_that_diverges_leaves_the_actuators_as_they_were():
    """As it leaves positions and velocities: what is not finite is not returned."""
    env = SFFRFlexEnv(overrides=[ON_OFF, "actuators.lag.joint=0.01"])
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.full(15, 0.9))
    state = env.get_state()
    broken = copy.deepcopy(state)
    broken["batch"].v[:, -1] = 1.0e6
    broken["batch"].v[:, 9:15] = 1.0e6
    env.set_state(broken)
    for _ in range(1000):
        before = env.get_state()["batch"]
        with np.errstate(all="ignore"):
            info = env.step(np.full(15, -0.9))[-1]
        if info["failure"] == Failure.NOT_FINITE:
            break
    else:
        pytest.fail("nothing diverged")
    after = env.get_state()["batch"]
    np.testing.assert_array_equal(after.p, before.p)
    np.testing.assert_array_equal(after.actuation, before.actuation)


def test_the_compiled_loop_drives_the_same_actuators(user_scenario):
    """As steps through Gymnasium's interface do."""
    scenario = user_scenario(duration=0.3, plant=DRAWS | {"on_off": 1.0}, offset_position=0.02)
    env = SFFRFlexEnv(scenario, overrides=["actuators.thruster_force=10", "actuators.thruster_torque=10"])
    policy = make_policy("ahsc", env)
    loop = rollout(env, policy, seed=3)
    obs, _ = env.reset(seed=3)
    policy.reset()
    signals = []
    for _ in range(env.ticks):
        obs, *_, info = env.step(policy(obs))
        signals.append((info["object_error"], info["thrust"], info["piezo_square"]))
    np.testing.assert_array_equal(np.array(signals), loop.signals[:, [0, 7, 6]])
    assert np.ptp(loop.signals[:, 7]) > 0.0


def test_sensors_give_multiples_of_their_steps(user_scenario):
    """What is measured, by its unit; the reference is known as it is, and nothing else changes."""
    steps = {"position": [1e-3, 1e-3], "angle": [2e-3, 2e-3], "velocity": [3e-3, 3e-3], "rate": [4e-3, 4e-3]}
    coarse = SFFRFlexEnv(user_scenario(sensors={"quantisation": steps}))
    fine = SFFRFlexEnv()
    first, _ = coarse.reset(seed=0)
    exact, _ = fine.reset(seed=0)
    rng, units = np.random.default_rng(2), {"m": 1e-3, "rad": 2e-3, "m/s": 3e-3, "rad/s": 4e-3}
    for _ in range(20):
        for field in coarse.fields.values():
            for k, unit in zip(range(field.start, field.start + field.size), field.units, strict=True):
                if not field.measured:
                    assert first[k] == exact[k]
                    continue
                assert abs(first[k] - exact[k]) <= units[unit] / 2.0 + 1e-12
                assert first[k] / units[unit] == pytest.approx(round(first[k] / units[unit]), abs=1e-6)
        action = rng.uniform(-0.2, 0.2, 15)
        first, exact = coarse.step(action)[0], fine.step(action)[0]
    np.testing.assert_array_equal(coarse.positions, fine.positions)


def test_half_of_the_episodes_of_thrust_are_on_off():
    """As the scenario says, and each says which it is."""
    env = SFFRFlexEnv("thrust")
    kinds = [env.reset(seed=seed)[1]["drawn_thrusters_on_off"] for seed in range(60)]
    assert 20 <= sum(kinds) <= 40
    assert load_scenario("thrust").plant.on_off == 0.5

"""States as they pass the border: the same future where they fit; refused, with nothing changed, where they do not."""

import copy
import operator
import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_gym.config.params import load_params
from sffr_gym.envs.fleet import make_fleet
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.status import REASONS
from sffr_gym.task.task_model import make_task_model

KINDS = {
    "single": SFFRFlexEnv,
    "vector": lambda *args, **arguments: SFFRFlexVectorEnv(3, **arguments),
    "damping": SFFRFlexDampingEnv,
    "damping vector": lambda **arguments: SFFRFlexDampingVectorEnv(3, **arguments),
}


def make(kind, seed=1, steps=2, **arguments):
    """An environment in the middle of an episode."""
    env = KINDS[kind](**{"scenario": "mismatch"} | arguments)
    env.reset(seed=seed)
    for _ in range(steps):
        env.step(np.zeros(env.action_space.shape))
    return env


def future(env):
    """What comes next: two steps and the start of another episode."""
    outputs = [env.step(np.full(env.action_space.shape, 0.1))[:2] for _ in range(2)] + [env.reset()[:1]]
    return [np.copy(each) for output in outputs for each in output]


def assert_refused(env, state, message):
    """A state is refused, and the environment goes on as its copy does, to which nothing was done."""
    untouched, kept = copy.deepcopy(env), pickle.dumps(env.get_state())
    with pytest.raises(ValueError, match=message) as raised:
        env.set_state(state)
    assert "\n" not in str(raised.value)
    assert pickle.dumps(env.get_state()) == kept
    for left, right in zip(future(env), future(untouched), strict=True):
        np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("kind", KINDS)
def test_a_state_brings_back_the_future_in_any_environment_of_the_robot(kind):
    """Scenario, plants, generators and their seeds come with it, into the same environment and a new one."""
    env = make(kind)
    state = env.get_state()
    seed, expected = env.np_random_seed, future(env)
    env.reset(seed=9, options={"scenario": "fast"})
    for each in (env, KINDS[kind](scenario="nominal"), make(kind, scenario="degraded")):
        each.set_state(state)
        assert each.scenario.name == "mismatch" and each.np_random_seed == seed
        for left, right in zip(future(each), expected, strict=True):
            np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("kind", KINDS)
def test_a_state_from_before_the_first_reset_is_one(kind):
    """It asks for a reset, wherever it is set."""
    state, env = KINDS[kind](scenario="nominal").get_state(), make(kind)
    env.set_state(state)
    with pytest.raises(Exception, match="call reset"):
        env.step(np.zeros(env.action_space.shape))


@pytest.mark.parametrize("kind", KINDS)
def test_a_state_of_another_robot_is_refused(kind):
    """By size, larger and smaller, and by the parameters where the sizes are the same."""
    for overrides in (["actuators.piezo.array=patches"], ["object=null"], ["base.mass=60"]):
        other = make(kind, overrides=overrides)
        for env, state in (make(kind), other.get_state()), (other, make(kind).get_state()):
            assert_refused(env, state, "of another robot")


@pytest.mark.parametrize("kind", ["vector", "damping vector"])
@pytest.mark.parametrize("n", [1, 2, 4])
def test_a_state_of_another_number_of_environments_is_refused(kind, n):
    """Fewer rows would be read beyond their end, more would be lost."""
    maker = SFFRFlexVectorEnv if kind == "vector" else SFFRFlexDampingVectorEnv
    other = maker(n, scenario="mismatch")
    other.reset(seed=0)
    assert_refused(make(kind), other.get_state(), "number of environments")
    assert_refused(other, make(kind).get_state(), "number of environments")


@pytest.mark.parametrize("other", [{"law": "hsc"}, {"rho": 5.0}, {"agent_period": 0.05}, {"base_tolerance": 0.01}])
@pytest.mark.parametrize("kind", ["damping", "damping vector"])
def test_a_state_of_another_law_is_refused(kind, other):
    """What runs inside decides how an episode goes on."""
    assert_refused(make(kind), make(kind, **other).get_state(), "of another robot or law: state.law is")


@pytest.mark.parametrize("kind", ["damping", "damping vector"])
def test_a_state_of_another_memory_is_refused(kind):
    """It has other observations."""
    message = r"state\.damping\.law\.seen: must have the shape \(\d, 36\), has \(\d, 72\)"
    assert_refused(make(kind), make(kind, stack_size=2).get_state(), message)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("column", [0, 1])
def test_a_path_that_stands_still_is_observed(kind, column):
    """A state whose circle has no radius, or no rate: its acceleration turns with no velocity."""
    env = make(kind)
    state = env.get_state()
    state["batch"].reference[:, column] = 0.0
    env.set_state(state)
    obs, reward, *_ = env.step(np.zeros(env.action_space.shape))
    assert obs in env.observation_space and np.isfinite(reward).all()


@pytest.mark.parametrize("state", [None, 3, [], {}, {"batch": None}, "state"])
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_state_is_refused(kind, state):
    """Whatever it is."""
    assert_refused(make(kind), state, "this state is of another robot")


NAN, HUGE = np.nan, 2**62
BATCH = {  # values that a field of the batch cannot have
    "tick": [-1, HUGE], "p": [NAN, np.inf], "v": [NAN], "reference": [NAN], "wrench": [np.inf], "level": [-1.0, NAN],
    "key": [-1, 2**32], "delay": [2, -1], "impulse_tick": [-2, HUGE], "impulse": [NAN], "obs": [1e9, NAN],
    "reward": [NAN], "terms": [NAN], "signals": [NAN], "cost": [NAN], "applied": [NAN], "clipped": [-1, 99],
    "status": [-1, len(REASONS)],
}  # fmt: skip
DAMPING = {
    "law.B_hat": [-1.0, NAN], "law.factor": [-1.0, np.inf], "law.share": [-0.1, 1.5, NAN], "law.demand": [-1.0, np.inf],
    "law.integral": [1e300, NAN], "law.errors": [NAN],
    "law.late": [2.0, NAN], "law.age": [-1.0, np.inf], "law.seen": [1e3, NAN], "price": [NAN], "end": [-1, HUGE],
}  # fmt: skip


def with_changed(arrays, name, change):
    """Return a named tuple whose array at a dotted name is what ``change`` makes of it."""
    first, _, rest = name.partition(".")
    own = getattr(arrays, first)
    return arrays._replace(**{first: with_changed(own, rest, change) if rest else change(own)})


def names_of(arrays):
    """Yield the dotted name of each array of a named tuple, nested at will."""
    for name, own in arrays._asdict().items():
        yield from (f"{name}.{inner}" for inner in names_of(own)) if hasattr(own, "_fields") else [name]


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_that_no_episode_has_are_refused(kind):
    """Each field has a range, and the message names field and value."""
    env = make(kind)
    fields = [("batch", name, value) for name, values in BATCH.items() for value in values]
    if "damping" in kind:
        fields += [("damping", name, value) for name, values in DAMPING.items() for value in values]
    for part, name, value in fields:
        state = env.get_state()
        operator.attrgetter(name)(state[part]).flat[-1] = value
        with pytest.raises(ValueError, match=rf"state\.{part}\.{name}: must"):
            env.set_state(state)
    assert_refused(env, state, r"state\.")


@pytest.mark.parametrize("kind", KINDS)
def test_arrays_of_another_form_are_refused(kind):
    """Cut, of another type, transposed in memory or no array at all."""
    env = make(kind)
    for part in ("batch", "damping") if "damping" in kind else ("batch",):
        for name in names_of(env.get_state()[part]):
            for change in (
                lambda array: array[..., :0] if array.size else array[None],
                lambda array: array.astype(np.float32),
                lambda array: array.tolist(),
                lambda array: None,
            ):
                state = env.get_state()
                state[part] = with_changed(state[part], name, change)
                with pytest.raises(ValueError, match=rf"state\.{part}\.{name}: must"):
                    env.set_state(state)


def test_an_episode_that_does_not_fit_is_refused():
    """Lengths, faults, sensors, impulses, parameters: what a single environment's next episode is made of."""
    env = make("single")
    episode = env.episode
    heavier = load_params().with_overrides("base.mass=500")
    for changes in (
        {"p": episode.p[:-1]}, {"v": np.full_like(episode.v, np.nan)}, {"ticks": 0}, {"ticks": 2**40}, {"ticks": "9"},
        {"plant": None}, {"plant": heavier}, {"prior": heavier}, {"plant": load_params().with_overrides("object=null")},
        {"plant": episode.plant.model_copy(update={"panel": None})},
        {"plant": episode.plant.model_copy(update={"panel": episode.plant.panel.model_copy(update={"EI": np.nan})})},
        {"health": episode.health._replace(thruster=2.0)}, {"health": episode.health._replace(piezo=np.ones(3))},
        {"sensing": episode.sensing._replace(delay=2)}, {"sensing": episode.sensing._replace(key=-1)},
        {"sensing": episode.sensing._replace(level=np.zeros(3))}, {"impulses": None}, {"drawn": None},
        {"impulses": episode.impulses._replace(tick=np.zeros(9, dtype=np.int64), impulse=np.zeros((9, 3)))},
        {"reference": episode.reference._replace(radius=np.inf)}, {"drawn": {"EI_factor": "1"}},
        {"reference": episode.reference._replace(joints=np.zeros(1))},
    ):  # fmt: skip
        state = env.get_state()
        state["episode"] = state["episode"]._replace(**changes)
        with np.errstate(all="ignore"), pytest.raises(ValueError, match=r"state\.episode|another robot"):
            env.set_state(state)
    assert_refused(env, state, r"state\.episode")


def test_plants_of_a_batch_that_do_not_fit_are_refused():
    """Their rows hold indices that the kernels follow."""
    env = make("vector")
    integers, steps = env.get_state()["fleet"].integers, _steps_column()
    for column in np.flatnonzero(integers[0] != 0).tolist():
        for value in (-1, integers[0, column] + 1000):
            state = env.get_state()
            state["fleet"].integers[1, column] = value
            if column == steps and value > 0:
                continue
            with pytest.raises(ValueError, match=r"state\.fleet"):
                env.set_state(state)
    for changes in ({"numbers": np.zeros((3, 5))}, {"integers": integers[:2]}):
        state = env.get_state()
        state["fleet"] = state["fleet"]._replace(**changes)
        with pytest.raises(ValueError, match="of another robot"):
            env.set_state(state)
    state = env.get_state()
    state["fleet"].numbers[2, 7] = np.nan
    assert_refused(env, state, r"state\.fleet\.numbers: must be finite")


def _steps_column():
    """Where the number of integration steps stands, which may differ among plants."""
    robots = (load_params().with_overrides(f"simulation.max_step={step}") for step in (1.0e-3, 2.0e-3))
    one, other = (make_fleet(make_task_model(robot)).integers[0] for robot in robots)
    (column,) = np.flatnonzero(one != other)
    return int(column)


@pytest.mark.parametrize("name", ["nominal", "mismatch", "fast", "noise", "impulse", "degraded"])
def test_states_of_other_scenarios_are_taken(name):
    """The plant and its faults belong to the state, not to the environment that takes it."""
    for kind in ("single", "vector"):
        state = make(kind, scenario=name).get_state()
        env = make(kind, scenario="payload")
        env.set_state(state)
        assert env.scenario == load_scenario(name)


@pytest.fixture(scope="module")
def batches():
    """An environment of each kind, with a state."""
    envs = {kind: make(kind) for kind in KINDS}
    return {kind: (env, env.get_state()) for kind, env in envs.items()}


@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_a_damaged_state_is_refused_or_works(batches, data):
    """No number that is put anywhere in a state makes the environment return what is not finite, or crash."""
    env, good = batches[data.draw(st.sampled_from(sorted(KINDS)))]
    env.set_state(good)
    state = env.get_state()
    part = data.draw(st.sampled_from([name for name in ("batch", "fleet", "damping") if name in state]))
    arrays = {name: operator.attrgetter(name)(state[part]) for name in names_of(state[part])}
    arrays = {name: each for name, each in arrays.items() if isinstance(each, np.ndarray) and each.size}
    array = arrays[data.draw(st.sampled_from(sorted(arrays)))]
    numbers = st.integers(-(2**63), 2**63 - 1) if array.dtype.kind == "i" else st.floats()
    array.flat[data.draw(st.integers(0, array.size - 1))] = data.draw(numbers)
    with np.errstate(all="ignore"):
        try:
            env.set_state(state)
        except ValueError:
            return
        for _ in range(2):
            obs, reward, *_ = env.step(np.zeros(env.action_space.shape))
            assert part == "fleet" or (obs in env.observation_space and np.isfinite(reward).all())


@pytest.mark.parametrize("kind", KINDS)
def test_how_the_arrays_of_a_state_lie_does_not_matter(kind):
    """Column by column, with gaps or backwards, as slices of something larger may."""

    def scattered(array):
        wide = np.zeros((*array.shape[:-1], 2 * array.shape[-1]), dtype=array.dtype)
        wide[..., ::-2] = array
        return wide[..., ::-2]

    env = make(kind)
    state = env.get_state()
    expected = future(env)
    for lay in (np.asfortranarray, scattered):
        state["batch"] = type(state["batch"])(*map(lay, state["batch"]))
        env.set_state(state)
        for left, right in zip(future(env), expected, strict=True):
            np.testing.assert_array_equal(left, right)

"""Pictures as a part of the state, in copies, and kept by a recorder."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest

from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_gym import ConfigError, load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.plants import drawn_plant
from sffr_gym.task.scenario import load_scenario, scenario_names

pytest.importorskip("PIL")
from sffr_gym.render.renderer import ALARM

KINDS = {
    "single": (SFFRFlexEnv, 37),
    "vector": (lambda **arguments: SFFRFlexVectorEnv(2, **arguments), 37),
    "damping": (SFFRFlexDampingEnv, 3),
    "damping vector": (lambda **arguments: SFFRFlexDampingVectorEnv(2, **arguments), 3),
}
MODES = [(name, mode) for name in KINDS for mode in (None, "rgb_array")] + [("single", "human"), ("damping", "human")]
VIEW = slice(160, 380)  # rows of the robot, below its swing and above the voltages
COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda env: pickle.loads(pickle.dumps(env))}


@pytest.fixture(params=KINDS)
def kind(request):
    """What makes an environment, and a number of steps that ends between two pictures of the undamped ones."""
    return KINDS[request.param]


def advance(env, steps, seed=0):
    """Step with small random actions; return the last observation and reward."""
    rng, last = np.random.default_rng(seed), None
    for _ in range(steps):
        last = env.step(0.05 * rng.uniform(-1.0, 1.0, env.action_space.shape))[:2]
    return last


def pictures(env):
    """The picture of each environment (n, height, width, 3)."""
    return np.reshape(env.render(), (-1, 600, 600, 3))


@pytest.mark.parametrize("scenario", ["excited", "mismatch", "fast"])
def test_same_state_gives_the_same_pictures(kind, scenario):
    """In the same environment after it went on, and in a new one, now and later."""
    make, steps = kind
    env, twin = (make(scenario=scenario, render_mode="rgb_array") for _ in range(2))
    env.reset(seed=3)
    advance(env, steps)
    state, before = env.get_state(), pictures(env)
    advance(env, 2 * steps)
    later = pictures(env)
    assert (later != before).any()
    for each in env, twin:
        each.set_state(pickle.loads(pickle.dumps(state)))
        np.testing.assert_array_equal(pictures(each), before)
        advance(each, 2 * steps)
        np.testing.assert_array_equal(pictures(each), later)


@pytest.mark.parametrize("scenario", ["excited", "mismatch"])
def test_state_of_environments_without_pictures_is_drawn_without_its_past(kind, scenario):
    make, _ = kind
    blind, seeing, other = (make(scenario=scenario, render_mode=mode) for mode in (None, "rgb_array", "rgb_array"))
    for env in blind, seeing:
        env.reset(seed=3)
        advance(env, 20)
    other.set_state(blind.get_state())
    seen, restored = pictures(seeing), pictures(other)
    assert (seen[:, VIEW] == restored[:, VIEW]).mean() > 0.995  # beside the bars of the swing
    assert (seen[:, 452:] != restored[:, 452:]).any()
    trace = other.get_state()["trace"]
    for past in trace if isinstance(trace, list) else [trace]:
        assert len(past.rows) == 1 and past.moment.tick > 0


def test_state_of_an_environment_with_pictures_suits_one_without(kind):
    make, steps = kind
    seeing, blind = make(render_mode="rgb_array"), make()
    seeing.reset(seed=3)
    advance(seeing, steps)
    blind.set_state(seeing.get_state())
    for one, other in zip(advance(seeing, 3), advance(blind, 3), strict=True):
        np.testing.assert_array_equal(one, other)


def test_state_before_the_first_reset_has_no_picture(kind):
    make, _ = kind
    env, twin = make(render_mode="rgb_array"), make(render_mode="rgb_array")
    twin.set_state(env.get_state())
    with pytest.raises(gym.error.ResetNeeded):
        twin.render()


@pytest.mark.parametrize("scenario", scenario_names())
def test_plant_is_that_of_what_was_drawn(scenario):
    chosen = load_scenario(scenario)
    known = nominal(load_params(), chosen)
    for seed in range(3):
        episode = draw(chosen, known, np.random.default_rng(seed))
        assert drawn_plant(known.plant, episode.drawn) == episode.plant


@pytest.mark.parametrize(
    "place,damage",
    [
        ("rows", lambda past: past._replace(rows=past.rows[:, :-1])),
        ("rows", lambda past: past._replace(rows=np.full_like(past.rows, np.nan))),
        ("rows", lambda past: past._replace(rows=None)),
        ("moment.p", lambda past: past._replace(moment=past.moment._replace(p=past.moment.p[:-1]))),
        ("moment.v", lambda past: past._replace(moment=past.moment._replace(v=np.full_like(past.moment.v, np.inf)))),
        ("moment.tick", lambda past: past._replace(moment=past.moment._replace(tick=10**9))),
        ("moment.status", lambda past: past._replace(moment=past.moment._replace(status=99.0))),
        ("title", lambda past: past._replace(title=b"")),
        ("", lambda past: (1, 2)),
        ("", lambda past: past.rows),
    ],
)
def test_picture_of_another_robot_is_refused(kind, place, damage):
    """In a line that names the place; the environment stays as it was."""
    make, steps = kind
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    advance(env, steps)
    state, before = env.get_state(), pictures(env)
    past = state["trace"]
    damaged = [past[0], damage(past[1])] if isinstance(past, list) else damage(past)
    with pytest.raises(ValueError, match=rf"state\.trace(\.1)?{f'.{place}' if place else ''}: ") as error:
        env.set_state(state | {"trace": damaged})
    assert "\n" not in str(error.value)
    np.testing.assert_array_equal(pictures(env), before)


@pytest.mark.parametrize("factor", [0.0, -1.0, 1e9, np.nan])
def test_plant_that_no_scenario_draws_is_refused(factor):
    env = SFFRFlexVectorEnv(2, scenario="mismatch", render_mode="rgb_array")
    env.reset(seed=0)
    state = env.get_state()
    state["drawn"]["EI_factor"][0][1] = factor
    with pytest.raises(ValueError, match=r"drawn: EI_factor = .*: no scenario draws that"):
        env.set_state(state)


@pytest.mark.parametrize("name,mode", MODES)
@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("stage", ["made", "reset", "drawn"])
def test_copies_go_on_exactly(name, mode, how, stage, clock):
    """In every mode, wherever they were; generators included."""
    if mode == "human":
        pytest.importorskip("pygame")
    env = KINDS[name][0](scenario="excited", render_mode=mode)
    if stage != "made":
        env.reset(seed=3)
        advance(env, 1)
    if stage == "drawn" and mode:
        env.render()
    twin = COPIES[how](env)
    ends = []
    for each in env, twin:
        if stage == "made":
            each.reset(seed=3)
        end = list(advance(each, 25))
        end += [each.reset()[0], *([pictures(each)] if mode == "rgb_array" else [])]
        ends.append(end)
        each.close()
    for one, other in zip(*ends, strict=True):
        np.testing.assert_array_equal(one, other)


def test_copies_of_wrapped_environments_go_on_exactly():
    env = gym.make("sffr_gym:SFFRFlex-v0", scenario="excited", render_mode="rgb_array")
    env.reset(seed=1)
    twin = copy.deepcopy(env)
    np.testing.assert_array_equal(*(advance(each, 22)[0] for each in (env, twin)))
    np.testing.assert_array_equal(env.render(), twin.render())


def test_recorder_that_keeps_a_picture_of_each_step_keeps_few():
    """Gymnasium's recorders keep what render() returns after each step: 25 arrays for a simulated second."""
    env = gym.wrappers.RenderCollection(gym.make("sffr_gym:SFFRFlex-v0", render_mode="rgb_array"))
    env.reset(seed=0)
    for _ in range(100):
        env.step(np.zeros(env.action_space.shape))
    kept = env.render()
    distinct = {id(picture): picture for picture in kept}
    assert len(kept) == 101 and len(distinct) == 6
    assert not any(np.shares_memory(a, b) for a in distinct.values() for b in distinct.values() if a is not b)
    assert not any(picture.flags.writeable for picture in distinct.values())
    seconds = env.unwrapped.ticks * env.unwrapped.prior_task.period
    assert sum(picture.nbytes for picture in distinct.values()) / 0.2 * seconds < 8e9  # a nominal episode


@pytest.mark.parametrize("every,distinct", [(0.0, 11), (0.002, 11), (0.01, 3), (60.0, 1)])
def test_time_between_pictures_is_an_argument(every, distinct):
    env = gym.make("sffr_gym:SFFRFlex-v0", render_mode="rgb_array", render_every=every)
    env.reset(seed=0)
    kept = [env.render()]
    for _ in range(10):
        env.step(np.zeros(env.action_space.shape))
        kept.append(env.render())
    assert len({id(picture) for picture in kept}) == distinct


def test_every_step_is_drawn_where_steps_are_longer():
    env = SFFRFlexDampingEnv(render_mode="rgb_array", agent_period=0.11)
    env.reset(seed=0)
    kept = [env.render()]
    for _ in range(4):
        env.step(np.zeros(env.action_space.shape))
        kept.append(env.render())
    assert len({id(picture) for picture in kept}) == 5
    assert len(env.get_state()["trace"].rows) == 5


@pytest.mark.parametrize("every", [-0.1, 60.1, float("nan"), float("inf")])
@pytest.mark.parametrize("mode", [None, "rgb_array"])
def test_time_between_pictures_has_a_range(kind, every, mode):
    with pytest.raises(ConfigError, match=r"render_every = .*: must be from 0, a picture of every step, to 60 s"):
        kind[0](render_mode=mode, render_every=every)


def test_end_of_an_episode_is_drawn_at_once():
    env = SFFRFlexEnv(render_mode="rgb_array", overrides=["limits.position=1.0e-7"])
    env.reset(seed=0)
    first = env.render()
    assert env.step(np.ones(env.action_space.shape))[2]
    last = env.render()
    assert not (first == ALARM).all(axis=-1).any() and (last == ALARM).all(axis=-1).sum() > 20


@pytest.mark.parametrize("period,rate", [(0.1, 10), (0.03, 100.0 / 3.0), (3.0, 1.0 / 3.0)])
def test_frame_rate_lets_videos_play_in_real_time(period, rate):
    for make in SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv:
        assert make(agent_period=period).metadata["render_fps"] == pytest.approx(rate, rel=1e-12)

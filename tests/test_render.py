"""Pictures of the environments: they read the state and nothing else, and show what they should."""

import hashlib
import pickle
import sys

import gymnasium as gym
import numpy as np
import pytest

from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv

pytest.importorskip("PIL")
from sffr_gym.physics.kinematics import modal_tip_deflections
from sffr_gym.render.canvas import Canvas
from sffr_gym.render.renderer import SIZE, Renderer, Snapshot, Style, label_place
from sffr_gym.render.robot import PANEL, voltage_colour
from sffr_gym.task.quasi_static import quasi_static_at

N_ACTIONS = 15


def actions(count, seed=0):
    """Small random actions (count, 15)."""
    return 0.02 * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, N_ACTIONS))


def run(env, inputs):
    """Step through inputs."""
    for action in inputs:
        env.step(action)


def digest(picture):
    return hashlib.sha256(picture.tobytes()).hexdigest()


@pytest.fixture
def env():
    """An environment some steps into an episode."""
    env = SFFRFlexEnv("excited", render_mode="rgb_array")
    env.reset(seed=3)
    run(env, actions(60))
    return env


@pytest.fixture
def drawn(env):
    """A snapshot of it, and what draws snapshots."""
    trace = np.array([[0.0, 1e-5, 0.02, 0.1, -0.2], [0.1, 2e-5, 0.03, 0.15, 0.1]])
    snapshot = Snapshot(0.12, env.positions, env.velocities, np.zeros(N_ACTIONS), trace)
    return Renderer(env.plant, env.reference, "title", "subtitle"), snapshot


def test_picture_is_one(env):
    picture = env.render()
    assert picture.shape == (SIZE, SIZE, 3) and picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 200
    assert picture.flags.owndata and not picture.flags.writeable


def test_rendering_reads_only():
    """Whether, and how often, pictures are taken does not change what happens."""
    plain, seen = SFFRFlexEnv("excited"), SFFRFlexEnv("excited", render_mode="rgb_array")
    ends = []
    for each in (plain, seen):
        each.reset(seed=3)
        for action in actions(60):
            each.step(action)
            if each is seen:
                before = pickle.dumps(each.get_state())
                each.render()
                assert pickle.dumps(each.get_state()) == before
        ends.append(each.step(np.zeros(N_ACTIONS)))
    (obs, reward, *_), (other_obs, other_reward, *_) = ends
    np.testing.assert_array_equal(obs, other_obs)
    assert reward == other_reward


def test_same_state_gives_the_same_pixels(env):
    """Also in another environment, after other pictures, and after going on and back."""
    state, first = env.get_state(), digest(env.render())
    run(env, actions(40, seed=1))
    assert digest(env.render()) != first
    env.set_state(state)
    assert digest(env.render()) == first
    other = SFFRFlexEnv("excited", render_mode="rgb_array")
    other.reset(seed=8)
    other.render()
    other.set_state(state)
    assert digest(other.render()) == first
    again = pickle.loads(pickle.dumps(other))
    assert digest(again.render()) == first


def test_state_of_an_environment_without_pictures_can_be_drawn(env):
    blind = SFFRFlexEnv("excited")
    blind.reset(seed=3)
    run(blind, actions(60))
    before = env.render()
    env.set_state(blind.get_state())
    after = env.render()
    view = slice(70, 440)  # without title and small plots, whose past is not known
    assert (before[view] == after[view]).mean() > 0.99


@pytest.mark.parametrize(
    "change", ["t", "p base", "p joint", "p panel", "volts", "thrust", "torque", "trace", "failure"]
)
def test_everything_in_a_snapshot_shows(drawn, change):
    renderer, snapshot = drawn
    p, applied, trace = snapshot.p.copy(), snapshot.applied.copy(), snapshot.trace.copy()
    match change:
        case "t":
            other = snapshot._replace(t=3.0)
        case "failure":
            other = snapshot._replace(failure="lost grasp")
        case "trace":
            trace[-1, 3] = 0.3
            other = snapshot._replace(trace=trace)
        case "p base" | "p joint" | "p panel":
            p[{"p base": 2, "p joint": 3, "p panel": 10}[change]] += 0.1
            other = snapshot._replace(p=p)
        case _:
            applied[{"volts": 1, "thrust": 6, "torque": 8}[change]] = 4.0
            other = snapshot._replace(applied=applied)
    assert (renderer(snapshot) != renderer(other)).any(axis=-1).sum() > 20


def test_plumes_grow_with_the_thrust_and_leave_against_it(drawn):
    """A push along +x blows to the left of the base."""
    renderer, snapshot = drawn
    still, (left, right) = renderer(snapshot), (slice(180, 280), slice(322, 340))
    lit = []
    for newtons in (2.0, 4.0):
        applied = snapshot.applied.copy()
        applied[6] = newtons
        changed = (renderer(snapshot._replace(applied=applied)) != still).any(axis=-1)[200:300]
        lit.append(changed[:, left].sum())
        assert changed[:, left].sum() > 5 * changed[:, right].sum()
    assert 1.5 * lit[0] < lit[1]


def test_exaggeration_moves_the_tips(drawn):
    renderer, snapshot = drawn
    pictures = [
        Renderer(renderer.params, renderer.reference, "title", "subtitle", Style(exaggeration=factor))(snapshot)
        for factor in (1.0, 5.0)
    ]
    changed = np.flatnonzero((pictures[0] != pictures[1]).any(axis=-1)[60:380].any(axis=1)) + 60
    assert changed.min() < 100  # up to the upper tip


def test_sizes_scale(drawn):
    renderer, snapshot = drawn
    for size in (200, 480, 900):
        picture = Renderer(renderer.params, renderer.reference, "title", style=Style(size=size))(snapshot)
        assert picture.shape == (size, size, 3)


@pytest.mark.parametrize(
    "overrides",
    [
        ["object=null"],
        ["object=null", "arms=[]", "initial.q=[0, 0, 0]", "initial.qd=[0.85, 0, 0]"],
        ["panel.mounts=[]"],
        ["panel.elements=3", "panel.mounts=[{name: one, root: [0.3, -0.7], angle: 2.1}]"],
        ["actuators.piezo.array=patches", "path.heading=tangent"],
        ["actuators.piezo.array=tip"],
    ],
)
def test_other_robots_are_drawn(overrides):
    env = SFFRFlexEnv(overrides=overrides, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.full(env.action_space.shape, 0.1))
    assert env.render().std() > 5.0


def test_state_far_out_of_range_is_drawn():
    env = SFFRFlexEnv(render_mode="rgb_array")
    env.reset(seed=0)
    state = env.get_state()
    state["batch"].p[0, 9:] *= 1e5
    env.set_state(state)
    assert env.render().shape == (SIZE, SIZE, 3)


def test_voltages_have_colours_by_sign_and_size():
    assert voltage_colour(0.0, 200.0) == PANEL
    warm, cold = voltage_colour(200.0, 200.0), voltage_colour(-200.0, 200.0)
    assert warm[0] > 200 > cold[0] and cold[2] > 200 > warm[2]
    reds = [voltage_colour(volts, 200.0)[0] for volts in (0.0, 0.1, 1.0, 10.0, 100.0, 200.0)]
    assert reds == sorted(set(reds))
    assert voltage_colour(1e6, 200.0) == warm


def test_bonded_pair_shows_each_patch_on_its_face():
    """The first of a pair lies on the face towards the panel's +y, which of the left panel is the picture's left."""
    env = SFFRFlexEnv(render_mode="rgb_array", overrides=["actuators.piezo.array=patches"])
    env.reset(seed=0)
    renderer, panel = Renderer(env.plant, env.reference, "title"), slice(260, 340)
    still = Snapshot(0.0, env.positions, env.velocities, np.zeros_like(env.prior_task.scale), np.zeros((0, 5)))
    places = []
    for channel in (0, 1):
        applied = still.applied.copy()
        applied[channel] = 50.0
        changed = (renderer(still._replace(applied=applied)) != renderer(still)).any(axis=-1)[70:240, panel]
        places.append(np.flatnonzero(changed.any(axis=0)).mean())
    assert places[0] < places[1] - 3


def test_number_above_is_the_swing_of_the_last_seconds(drawn, monkeypatch):
    """Peak to peak about the shape that the path alone gives; what is older or follows that shape does not count."""
    renderer, snapshot = drawn
    words = []
    monkeypatch.setattr(Canvas, "text", lambda self, place, text, *rest: words.append(text))
    t = np.array([0.0, 12.0, 15.0, 20.0])
    rest = modal_tip_deflections(renderer.model, quasi_static_at(renderer.model, renderer.reference, t))
    assert np.ptp(rest[1:, 0]) > 0.02
    swing = np.array([0.4, -0.1, 0.2, 0.0])
    rows = np.column_stack([t, np.full((4, 2), 1e-5), rest[:, 0] + swing, rest[:, 1]])
    p = renderer._quasi_static(snapshot._replace(t=20.0))
    renderer(snapshot._replace(t=20.0, p=p, trace=rows))
    assert "300 mm" in words and "swing of the tips, last 10 s" in words


def test_no_path_strikes_out_how_much_of_it_is_done():
    """A circle has room in its middle; a line, and a figure-eight that crosses there, have it below."""
    turn, middle = np.linspace(0.0, 2.0 * np.pi, 91), np.array([66.0, 58.0])
    circle = middle + 42.0 * np.column_stack([np.sin(turn), np.cos(turn)])
    eight = middle + 42.0 * np.column_stack([np.sin(2.0 * turn) / 2.0, np.cos(turn)])
    line = middle + np.column_stack([np.linspace(-42.0, 42.0, 91), np.linspace(5.0, -5.0, 91)])
    assert label_place(circle, middle, 20.0) == (66.0, 58.0)
    assert label_place(eight, middle, 20.0) == (66.0, 120.0)
    assert label_place(line, middle, 20.0) == (66.0, 83.0)


def test_vector_form_is_the_single_pictures():
    """A frame for each environment, that of the single one with its seed but for the subtitle."""
    vector = SFFRFlexVectorEnv(2, scenario="excited", render_mode="rgb_array")
    vector.reset(seed=3)
    for action in actions(60):
        vector.step(np.tile(action, (2, 1)))
    pictures = vector.render()
    assert isinstance(pictures, tuple) and len(pictures) == 2
    assert (pictures[0] != pictures[1]).any()
    for i, picture in enumerate(pictures):
        single = SFFRFlexEnv("excited", render_mode="rgb_array")
        single.reset(seed=3 + i)
        run(single, actions(60))
        np.testing.assert_array_equal(picture[60:], single.render()[60:])


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_new_episode_of_a_batch_starts_with_an_empty_trace(mode):
    vector = SFFRFlexVectorEnv(2, max_episode_steps=50, render_mode="rgb_array", autoreset_mode=mode)
    vector.reset(seed=0)
    first = vector.render()[0]
    for _ in range(50 + (mode == "NextStep")):
        vector.step(np.zeros((2, N_ACTIONS)))
    np.testing.assert_array_equal(vector.render()[0], first)


def test_window_shows_in_step_with_the_simulation(monkeypatch):
    """Every 20th control period a picture, of which the screen has the pixels; closing it leaves the rest running."""
    pygame = pytest.importorskip("pygame")
    env = gym.make("SFFRFlex-v0", render_mode="human")
    env.reset(seed=0)
    flips = []
    monkeypatch.setattr(pygame.display, "flip", lambda: flips.append(env.unwrapped.time))
    run(env, actions(40))
    np.testing.assert_allclose(flips, [0.04, 0.08])
    assert env.render() is None and len(flips) == 3
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    still = SFFRFlexEnv(render_mode="rgb_array")
    still.reset(seed=0)
    run(still, actions(40))
    np.testing.assert_array_equal(shown, still.render())
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    run(env, actions(40))
    assert len(flips) == 4 and not pygame.display.get_init()
    env.close()
    env.close()


def test_window_without_pygame_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    env = SFFRFlexEnv(render_mode="human")
    with pytest.raises(gym.error.DependencyNotInstalled, match=r"pip install 'sffr-gym\[render\]'"):
        env.reset(seed=0)


@pytest.mark.parametrize("make", [SFFRFlexEnv, SFFRFlexVectorEnv])
def test_render_mode_without_pillow_says_what_to_install(monkeypatch, make):
    for name in ("environment", "renderer", "robot", "plots", "canvas"):
        monkeypatch.delitem(sys.modules, f"sffr_gym.render.{name}", raising=False)
    monkeypatch.setitem(sys.modules, "PIL", None)
    make()
    with pytest.raises(gym.error.DependencyNotInstalled, match=r"pip install 'sffr-gym\[render\]'"):
        make(render_mode="rgb_array")


def test_frame_rate_is_that_of_the_steps():
    assert SFFRFlexEnv().metadata["render_fps"] == 500
    for make in (SFFRFlexEnv, SFFRFlexVectorEnv):
        assert make(overrides=["control.period=0.005"]).metadata["render_fps"] == 200
    assert SFFRFlexEnv.metadata["render_fps"] == 500


@pytest.mark.parametrize("make", [SFFRFlexEnv, SFFRFlexVectorEnv])
def test_picture_before_the_first_reset_raises(make):
    with pytest.raises(gym.error.ResetNeeded):
        make(render_mode="rgb_array").render()


def test_picture_without_a_render_mode_warns():
    env = gym.make("SFFRFlex-v0")
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None

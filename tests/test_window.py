"""The window: in step with real time, and no trouble for the program that it belongs to."""

import builtins
import copy

import numpy as np
import pytest
from gymnasium import error

from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_gym.envs.single import SFFRFlexEnv

pytest.importorskip("PIL")
pygame = pytest.importorskip("pygame")


@pytest.fixture(autouse=True)
def no_window_stays():
    yield
    pygame.display.quit()


def start(make=SFFRFlexEnv, **arguments):
    """An environment with a window, at the start of an episode."""
    env = make(render_mode="human", **arguments)
    env.reset(seed=0)
    return env


def step(env, count=1):
    for _ in range(count):
        env.step(np.zeros(env.action_space.shape))


@pytest.mark.parametrize(
    "make,arguments,steps,seconds",
    [
        (SFFRFlexEnv, {}, 200, 0.4),
        (SFFRFlexEnv, {"overrides": ["control.period=0.003"]}, 140, 0.42),
        (SFFRFlexEnv, {"render_every": 0.2}, 200, 0.4),
        (SFFRFlexDampingEnv, {}, 4, 0.4),
        (SFFRFlexDampingEnv, {"agent_period": 0.05}, 8, 0.4),
        (SFFRFlexDampingEnv, {"agent_period": 0.022}, 20, 0.44),
        (SFFRFlexDampingEnv, {"agent_period": 2.0}, 2, 4.0),
    ],
)
def test_simulated_time_passes_in_real_time(clock, make, arguments, steps, seconds):
    env = start(make, **arguments)
    begin = clock.now
    step(env, steps)
    assert clock.now - begin == pytest.approx(seconds, abs=0.045)


def test_slow_program_is_not_slowed_further_and_does_not_race_afterwards(clock):
    env = start()
    clock.now += 5.0  # as long as somebody thinks
    begin = clock.now
    step(env, 20)
    assert clock.now == begin
    step(env, 20)
    assert clock.now - begin == pytest.approx(0.04)


def test_new_episode_and_another_state_do_not_wait_for_the_time_between(clock):
    env = start()
    step(env, 200)
    state, begin = env.get_state(), clock.now
    env.reset(seed=1)
    step(env, 20)
    assert clock.now - begin == pytest.approx(0.04)
    env.set_state(state)
    step(env, 20)
    assert clock.now - begin == pytest.approx(0.04)


def test_copies_show_nothing_before_their_next_episode(clock, monkeypatch):
    """A planner's look ahead neither opens nor fills a window, nor waits; the original's stays."""
    env = start()
    flips, flip = [], pygame.display.flip
    monkeypatch.setattr(pygame.display, "flip", lambda: (flips.append(1), flip()))
    twin, begin = copy.deepcopy(env), clock.now
    step(twin, 100)
    assert not flips and clock.now == begin
    twin.close()
    assert pygame.display.get_init()
    twin.reset()
    assert len(flips) == 1
    step(env, 20)
    assert len(flips) == 2
    again = copy.deepcopy(env)
    again.render()
    assert len(flips) == 3


def test_window_closed_by_another_environment_opens_again(clock):
    one, other = start(), start()
    other.close()
    assert not pygame.display.get_init()
    step(one, 20)
    assert pygame.display.get_init()
    pygame.display.set_mode((100, 80))
    step(one, 20)
    assert pygame.display.get_surface().get_size() == (600, 600)
    one.close()
    one.close()
    assert not pygame.display.get_init()


def test_closing_it_ends_the_pictures_and_not_the_program(clock):
    env = start()
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    step(env, 20)
    assert not pygame.display.get_init()
    begin = clock.now
    step(env, 100)
    env.reset()
    assert env.render() is None and not pygame.display.get_init() and clock.now == begin
    env.close()


def test_click_is_noticed_while_the_window_waits(clock):
    env = start(SFFRFlexDampingEnv, agent_period=2.0)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    begin = clock.now
    step(env)
    assert clock.now - begin < 0.1 and not pygame.display.get_init()


def test_events_of_others_stay_in_the_queue(clock):
    env = start()
    pygame.event.clear()
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_a))
    step(env, 40)
    assert [event.key for event in pygame.event.get(pygame.KEYDOWN)] == [pygame.K_a]


def test_display_that_goes_away_ends_the_pictures_alone(clock, monkeypatch):
    env = start()

    def lost():
        raise pygame.error("display lost")

    monkeypatch.setattr(pygame.display, "flip", lost)
    with pytest.warns(UserWarning, match="without pictures: display lost"):
        step(env, 20)
    step(env, 20)
    env.close()


@pytest.mark.parametrize("driver", [None, "", "nonsense"])
def test_no_display_says_what_to_do(monkeypatch, driver):
    pygame.display.quit()
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    if driver is not None:
        monkeypatch.setenv("SDL_VIDEODRIVER", driver)
    monkeypatch.setattr(pygame.display, "get_driver", lambda: "offscreen")  # what SDL takes by itself
    with pytest.raises(error.Error, match=r"'human' cannot open a window: .*'rgb_array'.*SDL_VIDEODRIVER=dummy"):
        start()
    assert not pygame.display.get_init()


def test_pygame_that_cannot_be_loaded_says_what_to_do(monkeypatch):
    real = builtins.__import__

    def broken(name, *rest):
        if name.startswith("pygame"):
            raise ImportError("libSDL2-2.0.so.0: cannot open shared object file")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", broken)
    with pytest.raises(error.DependencyNotInstalled, match=r"cannot be loaded: libSDL2.*pip install"):
        start()


@pytest.mark.parametrize("problem", [ImportError("The _imagingft C module is not installed"), TypeError("0 arguments")])
def test_pillow_without_texts_says_what_to_do(monkeypatch, problem):
    from PIL import ImageFont

    def load_default(size):
        raise problem

    monkeypatch.setattr(ImageFont, "load_default", load_default)
    with pytest.raises(error.DependencyNotInstalled, match=r"Pillow 10.1 or later with FreeType.*sffr-gym\[render\]"):
        SFFRFlexEnv(render_mode="rgb_array")

"""The simulator's border: every argument that is not what a method takes raises a ValueError with its name."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sffr_gym import ConfigError, Simulator, State

METHODS = (
    "step", "mass_matrix", "bias", "acceleration", "energy", "momentum", "q_flex", "grasp_forces", "constraint_drift",
    "frequencies",
)  # fmt: skip
SHAPES = {"q": (9,), "qd": (9,), "qf": (2, 3), "qfd": (2, 3), "obj": (3,), "objd": (3,)}
NOT_NUMBERS: list[Any] = [
    "1.0", ["1", "2", "3"], [True, False, True], [1j, 0, 0], [10**400, 0, 0], [None, 0, 0], {}, object(),
    [[1.0], [1.0, 2.0]],
]  # fmt: skip


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    """Return the case study."""
    return Simulator()


@pytest.fixture(scope="module")
def free() -> Simulator:
    """Return the case study without its object."""
    return Simulator(Simulator().params.with_overrides("object=null"))


@pytest.mark.parametrize(
    "dt",
    [-0.002, 0.0, -0.0, np.nan, np.inf, -np.inf, 5e-324, 1e-12, 1e9, 1e300, 10**400, True, np.True_, "0.002", [0.002],
     np.array(0.002), 1j, Fraction(1, 500)],
)  # fmt: skip
def test_durations_that_are_none_or_have_no_end(simulator: Simulator, dt: Any) -> None:
    """Nothing, backwards, no number, too short to move anything, and for ever."""
    with pytest.raises(ValueError, match=r"^dt must be "):
        simulator.step(simulator.initial_state(), dt=dt)


@pytest.mark.parametrize("dt", [np.float32(0.002), np.int64(1), 1, 1e-9])
def test_durations_that_are_numbers(simulator: Simulator, dt: Any) -> None:
    """Of whatever type, and of whatever length that can be computed."""
    state = simulator.step(simulator.initial_state(), dt=dt)
    assert state.t == float(dt) and np.isfinite(state.qfd).all()


@pytest.mark.parametrize("name", ["base", "joints", "piezo_tau", "piezo_volts", "wrench"])
@pytest.mark.parametrize("value", NOT_NUMBERS)
def test_commands_that_are_no_numbers(simulator: Simulator, name: str, value: Any) -> None:
    """Texts, booleans, complex and unbounded numbers, nothing, and lists of different lengths."""
    with pytest.raises(ValueError, match=rf"^{name} must "):
        simulator.step(simulator.initial_state(), **{name: value})


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("field", SHAPES)
def test_states_of_another_robot(simulator: Simulator, method: str, field: str) -> None:
    """Every method names the field that does not fit."""
    state = simulator.initial_state()
    right = np.zeros(SHAPES[field])
    for wrong in (right[:-1], right[None], right + np.nan, right + 1j, right.astype(str), None, 0.0):
        with pytest.raises(ValueError, match=rf"^state\.{field} "):
            getattr(simulator, method)(replace(state, **{field: wrong}))


@pytest.mark.parametrize("t", [np.nan, np.inf, "0", None, [0.0], True])
def test_times_that_are_none(simulator: Simulator, t: Any) -> None:
    """The time of a state is a finite number."""
    with pytest.raises(ValueError, match=r"^state\.t "):
        simulator.step(replace(simulator.initial_state(), t=t))


@pytest.mark.parametrize("method", METHODS)
def test_what_is_no_state(simulator: Simulator, free: Simulator, method: str) -> None:
    """Also an object that only looks like one, and one that carries what the robot does not."""
    state = simulator.initial_state()
    for wrong in (None, 0.0, SimpleNamespace(**vars(state))):
        with pytest.raises(ValueError, match=r"^state must be a State, got "):
            getattr(simulator, method)(wrong)
    with pytest.raises(ValueError, match=r"^state\.obj and state\.objd must be None"):
        getattr(free, method)(state)


def test_lists_are_as_good_as_arrays(simulator: Simulator) -> None:
    """To the last bit."""
    state = simulator.initial_state()
    listed = State(state.t, *(getattr(state, name).tolist() for name in SHAPES))
    first, second = simulator.step(state, base=[1, 2, 3]), simulator.step(listed, base=np.array([1, 2, 3]))
    for name in SHAPES:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert simulator.energy(listed) == simulator.energy(state)


def test_a_motion_beyond_all_numbers_is_an_error(simulator: Simulator) -> None:
    """Instead of a state that is none."""
    beyond = r"^the motion grows beyond all numbers within dt = 0\.002 s"
    with np.errstate(all="ignore"), pytest.raises(FloatingPointError, match=beyond):
        simulator.step(simulator.initial_state(), wrench=[1e300, 0.0, 1e300])


def test_flat_vectors_and_commands_have_shapes(simulator: Simulator) -> None:
    """As everything else that comes from outside."""
    n = simulator.model.at.end
    for p, v, message in (
        (np.zeros(n - 1), np.zeros(n), r"^p must have shape"),
        (np.zeros(n), np.full(n, np.nan), r"^v has entries that are not finite"),
    ):
        with pytest.raises(ValueError, match=message):
            simulator.unflatten(0.0, p, v)
    with pytest.raises(ValueError, match=r"^command must have shape \(15,\)"):
        simulator.split(np.zeros(14))


@pytest.mark.parametrize(
    "settings",
    [{"max_step": value} for value in (0.0, -1.0, np.nan, np.inf, 1.0, 1e-300, True, "long", [1e-3])]
    + [{"integrator": value} for value in ("", "null", 4, "rk4, x", "euler")]
    + [{"coupling": value} for value in ("none", True, "exact: 1")],
)
def test_settings_have_ranges(settings: dict[str, Any]) -> None:
    """At construction."""
    with pytest.raises(ConfigError, match=next(iter(settings))):
        Simulator(**settings)

"""Counts the floating-point operations of a control period: the kernels as plain Python on numbers that count.

Run as ``python -m sffr_workbench.speed.count``, in a process of its own, since the kernels' modules get other functions
of ``math``. A kernel that is called by itself is the Python function that it was written as, and works on arrays of any
kind of number. Prints a JSON object, part by part.
"""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from sffr_baselines import make_policy
from sffr_baselines.control_law import control, law_shapes, make_states, perceive, state_at
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.physics.actuators import state_size
from sffr_gym.physics.dynamics import accelerations
from sffr_gym.physics.integrator import advance
from sffr_gym.task.control_period import control_period, observe_state, period_shapes
from sffr_gym.task.signals import N_SIGNALS
from sffr_workbench.speed.circle import make_course

KINDS = ("add", "multiply", "divide", "sqrt", "transcendental")
PACKAGES = ("sffr_gym", "sffr_baselines")
_count: Counter[str] = Counter()


class Counted:
    """A float that counts the operations that it takes part in; comparisons, signs and copies are free."""

    __slots__ = ("value",)

    def __init__(self, value: float) -> None:
        self.value = float(value)

    def __float__(self) -> float:
        return self.value

    def __bool__(self) -> bool:
        return self.value != 0.0

    def __neg__(self) -> Counted:
        return Counted(-self.value)

    def __abs__(self) -> Counted:
        return Counted(abs(self.value))

    def __lt__(self, other: Any) -> bool:
        return self.value < float(other)

    def __le__(self, other: Any) -> bool:
        return self.value <= float(other)

    def __gt__(self, other: Any) -> bool:
        return self.value > float(other)

    def __ge__(self, other: Any) -> bool:
        return self.value >= float(other)

    def __eq__(self, other: object) -> bool:
        return self.value == float(other)  # type: ignore[arg-type]

    __hash__ = None  # type: ignore[assignment]


def _operation(kind: str, apply: Callable[[float, float], float], swap: bool = False) -> Callable[..., Counted]:
    def operate(self: Counted, other: Any) -> Counted:
        _count[kind] += 1
        a, b = (float(other), self.value) if swap else (self.value, float(other))
        return Counted(apply(a, b))

    return operate


for _name, _kind, _apply in (
    ("add", "add", lambda a, b: a + b),
    ("sub", "add", lambda a, b: a - b),
    ("mul", "multiply", lambda a, b: a * b),
    ("truediv", "divide", lambda a, b: a / b),
    ("mod", "divide", lambda a, b: a % b),
):
    setattr(Counted, f"__{_name}__", _operation(_kind, _apply))
    setattr(Counted, f"__r{_name}__", _operation(_kind, _apply, swap=True))


def _function(name: str) -> Callable[..., Any]:
    """Return a function of ``math`` that counts itself, ``isfinite`` as free."""
    original = getattr(math, name)

    def call(*arguments: Any) -> Any:
        if name != "isfinite":
            _count["sqrt" if name == "sqrt" else "transcendental"] += 1
        result = original(*map(float, arguments))
        return Counted(result) if isinstance(result, float) else result

    return call


def counting(value: Any) -> Any:
    """Replace every float of arrays and tuples of arrays by one that counts."""
    if isinstance(value, tuple):
        return type(value)(*map(counting, value)) if hasattr(value, "_fields") else tuple(map(counting, value))
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        counted = np.empty(value.shape, dtype=object)
        counted[...] = np.vectorize(Counted, otypes=[object])(value) if value.size else value
        return counted
    return Counted(value) if isinstance(value, float) else value


def count_functions() -> None:
    """Let the kernels' modules use functions of ``math`` that count."""
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in PACKAGES:
            for function in "sin", "cos", "sqrt", "exp", "isfinite":
                if vars(module).get(function) is getattr(math, function):
                    setattr(module, function, _function(function))


def operations() -> dict[str, dict[str, int]]:
    """Count the operations of one control period of the case study, by part and kind."""
    course = make_course(1.0)
    policy: Any = make_policy("ahsc", course.params)
    law, n = policy.law, len(course.p)
    state, work = state_at(make_states(law, 1), 0), new_workspace(law_shapes(law))
    count_functions()
    plant, reference, law, state, work = map(counting, (course.plant, course.reference, law, state, work))
    p, v, obs = counting(course.p), counting(course.v), counting(course.obs)
    period = counting(new_workspace(period_shapes(course.plant)))
    n_u = len(course.plant.scale)
    tau, out, signals, command, actuation, wrench = (
        counting(np.zeros(size)) for size in (n, n, N_SIGNALS, n_u, state_size(n_u), 3)
    )
    model, inner = plant.model, period.step.dynamics
    parts: dict[str, Callable[[], Any]] = {
        "equations": lambda: accelerations(model, p, v, tau, inner, out, False, True),
        "step": lambda: advance(model, p, v, tau, plant.period, 1, plant.integrator, period.step),
        "view": lambda: observe_state(plant, reference, Counted(0.1), p, v, period, obs, signals),
        "law": lambda: (perceive(law, Counted(0.0), obs, state, work), control(law, state, work, command)),
        "plant": lambda: control_period(
            plant, reference, Counted(0.1), p, v, command, actuation, wrench, period, obs, signals
        ),
    }  # fmt: skip
    counts = {}
    for name, run in parts.items():
        _count.clear()
        run()
        counts[name] = {kind: _count[kind] for kind in KINDS}
    return counts


if __name__ == "__main__":
    print(json.dumps(operations()))

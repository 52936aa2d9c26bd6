"""Programs of a GPU: every kind of argument, when one serves for several plants, and the PTX of what is compiled."""

import re
from typing import Any, NamedTuple

import numpy as np
import pytest
from drawn import everything
from gymnasium.vector import AutoresetMode

from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingVectorEnv
from sffr_baselines.device_law import DeviceLaw
from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.cuda.described import (
    FIRST,
    LAST,
    Fixed,
    Memory,
    Own,
    Row,
    Rows,
    Thread,
    numbers_of,
    rows,
)
from sffr_gym.compile.cuda.program import Processor, build
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.library import load_library
from sffr_gym.envs.device import DeviceVectorEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv

pytestmark = [
    pytest.mark.skipif(load_library() is None, reason="compares compiled code"), pytest.mark.usefixtures("programs")
]  # fmt: skip
CAPABILITY = "sm_90"


class Inner(NamedTuple):
    gain: float
    matrix: Any
    count: int


class Scratch(NamedTuple):
    sums: Any


@kernel
def combine(plants, table, all_rows, own_row, flags, out, work, first, last):
    """Use every kind of argument; ``out`` (n, 2)."""
    for i in range(first, last):
        plant = plants[i if len(plants) > 1 else 0]
        for k in range(2):
            work.sums[k] = plant.gain * table[k] * plant.count
            for j in range(2):
                work.sums[k] += plant.matrix[k, j] * all_rows[i, j] + own_row[0, j]
            out[i, k] = work.sums[k] if flags[i] else -1.0


def combined(own):
    """A thread of it for three environments, and what it must give."""
    rng, n = np.random.default_rng(5), 3
    plants = [Inner(float(rng.uniform()), rng.uniform(size=(2, 2)), 2) for _ in range(n)]
    plants = plants if own else [plants[0]] * n
    numbers = rows(np, n, (5,), "f")
    numbers[...] = [numbers_of(plant) for plant in plants]
    table, flags, out = rng.uniform(size=2), np.array([True, False, True]), rows(np, n, (2,), "f")
    all_rows, own_row = rows(np, n, (2,), "f"), rows(np, n, (2,), "f")
    all_rows[...], own_row[...] = rng.uniform(size=(2, n, 2))
    seen = Own(plants[0], numbers) if own else Structures(plants[:1])
    thread = Thread("combine", combine, (
        seen, Fixed(table), Rows(all_rows), Row(own_row), Rows(flags), Rows(out), Memory(Scratch((2,))), FIRST, LAST,
    ))  # fmt: skip
    expected = [
        plant.gain * table * plant.count + plant.matrix @ all_rows[i] + own_row[i].sum() if flags[i] else [-1.0] * 2
        for i, plant in enumerate(plants)
    ]
    return thread, out, np.array(expected)


@pytest.mark.parametrize("own", [False, True])
def test_every_kind_of_argument(own):
    thread, out, expected = combined(own)
    Processor().launches(3, [thread])["combine"]()
    np.testing.assert_allclose(out, expected, rtol=1.0e-14)


def test_plants_that_differ_in_numbers_share_a_program():
    first, second = (combined(own=True)[0] for _ in range(2))
    changed = second._replace(arguments=(second.arguments[0]._replace(exemplar=Inner(9.0, np.ones((2, 2)), 2)),
                                         *second.arguments[1:]))  # fmt: skip
    assert build([first], "host") == build([changed], "host")
    more = second.arguments[0]._replace(exemplar=Inner(9.0, np.ones((2, 2)), 3))
    assert build([first], "host") != build([second._replace(arguments=(more, *second.arguments[1:]))], "host")


def test_a_thread_compiles_for_a_gpu():
    pytest.importorskip("cuda.pathfinder")
    ptx = build([combined(own=True)[0]], CAPABILITY).read_text()
    assert re.findall(r"\.entry (\w+)", ptx) == ["combine"]
    assert ".extern" not in ptx
    assert f".target {CAPABILITY}" in ptx


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (SFFRFlexVectorEnv, ["observe", "restart", "step"]),
        (SFFRFlexDampingVectorEnv, ["observe", "restart", "see", "step"]),
    ],
)
def test_everything_compiles_for_a_gpu(kind, names):
    """PTX with nothing unresolved, whose threads keep little in memory: loops unroll and arrays come apart."""
    pytest.importorskip("cuda.pathfinder")
    ptx = build([each for each in threads_of(kind(1)) if each.name != "draw"], CAPABILITY).read_text()
    assert sorted(re.findall(r"\.entry (\w+)", ptx)) == names
    assert ".extern" not in ptx
    assert f".target {CAPABILITY}" in ptx
    assert max(map(int, re.findall(r"__local_depot\d+\[(\d+)\]", ptx))) < 4096  # bytes of each thread


@pytest.mark.slow
def test_draws_compile_for_a_gpu():
    """Of a scenario that draws all that is drawn there."""
    pytest.importorskip("cuda.pathfinder")
    (draw,) = (each for each in threads_of(SFFRFlexVectorEnv(1, scenario=everything())) if each.name == "draw")
    ptx = build([draw], CAPABILITY).read_text()
    assert re.findall(r"\.entry (\w+)", ptx) == ["draw"]
    assert ".extern" not in ptx


@pytest.mark.slow
def test_a_learned_schedule_compiles_for_a_gpu():
    """Its network calls what the laws do not: all of it is found in libdevice."""
    pytest.importorskip("cuda.pathfinder")
    found = []

    class Listener(Processor):
        def launches(self, n, threads):
            found.extend(threads)
            return dict.fromkeys(thread.name for thread in threads)

    envs = DeviceVectorEnv(SFFRFlexVectorEnv(1), 2, AutoresetMode.NEXT_STEP, Listener())
    DeviceLaw(make_policy("ppo", envs.host).law, envs)
    ptx = build(found[-1:], CAPABILITY).read_text()
    assert re.findall(r"\.entry (\w+)", ptx) == ["act"]
    assert ".extern" not in ptx


def threads_of(host):
    """What environments have compiled."""
    found = []

    class Listener(Processor):
        def launches(self, n, threads):
            found.extend(threads)
            return {thread.name: lambda: None for thread in threads}

    DeviceVectorEnv(host, 2, AutoresetMode.NEXT_STEP, Listener()).reset(seed=0)
    return found

"""The interface of compiled code: which form arguments have, what kernels see of them, and what is refused."""

import copy
import pickle
import re

import numpy as np
import pytest
from small_kernels import WIDTH, add_up, divide, exemplars, links, multiply, operands, robot

from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_gym.compile import kernels
from sffr_gym.compile.arguments import Block, Structures
from sffr_gym.compile.kernels import ENTRIES
from sffr_gym.envs.batch import step_range
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.simulator import Simulator

MATRIX = np.arange(24.0).reshape(4, 6)


def words(*arguments):
    block = Block(arguments)
    return block._words.tolist()


@pytest.fixture
def small(monkeypatch, small_libraries):
    """Let entries be called in the library of the tests' own."""
    library = next(iter(small_libraries.values()))
    monkeypatch.setattr(kernels, "load_library", lambda: library)
    return library


@pytest.mark.parametrize(
    ("value", "form", "expected"),
    [
        (1.5, "f0", [np.float64(1.5).view(np.int64)]),
        (np.float64(-0.0), "f0", [np.iinfo(np.int64).min]),
        (7, "i0", [7]),
        (np.int32(-7), "i0", [-7]),
        (True, "b0", [1]),
        (np.False_, "b0", [0]),
        ((), "", []),
        ((1, (True, 2)), "i0b0i0", [1, 1, 2]),
    ],
)
def test_a_number_is_a_word(value, form, expected):
    assert Block((value,)).form == form and words(value) == expected


@pytest.mark.parametrize(
    ("array", "form"),
    [
        (MATRIX, "f2"),
        (MATRIX[::2, ::3], "F2"),
        (MATRIX[:, 1], "F1"),
        (MATRIX[2], "f1"),
        (MATRIX.T, "F2"),
        (np.zeros((2, 0)), "f2"),
        (np.arange(3), "i1"),
        (np.arange(6)[::2], "I1"),
        (np.zeros((2, 3, 4), dtype=bool), "b3"),
    ],
)
def test_an_array_is_its_address_lengths_and_strides(array, form):
    assert Block((array,)).form == form
    assert words(array) == [array.ctypes.data, *array.shape, *array.strides]


def test_the_last_axis_of_an_array_of_lanes_is_no_dimension():
    x = operands(True).x
    assert Block((x,)).form == "l1" and words(x) == [x.ctypes.data, 1, 8 * WIDTH]


@pytest.mark.parametrize(("lanes", "form"), [(False, "f2fx4"), (True, "l2lx4")])
@pytest.mark.parametrize("n", [1, 3])
def test_arrays_that_lie_entry_by_entry_share_an_address(lanes, form, n):
    work, _ = links(n, lanes)
    assert Block((work,)).form == form
    assert words(work)[-2:] == [work.vector.first.ctypes.data, n]
    assert Block(((work.vector.last, work.vector.first),)).form.lower() != f"{form[2]}x2"  # in another order


def test_structures_are_the_address_of_their_words():
    robots = Structures([robot(), robot(gain=2.0)])
    assert Block((robots,)).form == f"({Block((robot(),)).form})" == "(f0i0b0f1i1)"
    assert words(robots) == [robots.rows.ctypes.data, 2, 9]
    assert robots.rows[0, :3].tolist() == words(0.5, 3, True)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.zeros(3, dtype=np.float32), "float64, int64 and bool, got one of float32"),
        (np.zeros(3, dtype=np.int32), "got one of int32"),
        (np.zeros(3, dtype=">f8"), "got one of >f8"),
        (np.array([None]), "got one of object"),
        (np.zeros(17, dtype=np.uint8)[1:].view(np.float64), "aligned"),
        ([1.0], "arrays and numbers, got list"),
        (None, "got NoneType"),
        ("a", "got str"),
        (1j, "got complex"),
        (np.float32(1.0), "got float32"),
        ((1.0, [2.0]), "got list"),
    ],
)
def test_what_kernels_do_not_know_is_refused(value, message):
    with pytest.raises(TypeError, match=re.escape(message)):
        Block((value,))


def test_structures_of_several_forms_are_refused():
    strided = robot()._replace(vector=np.arange(6.0)[::2])
    with pytest.raises(TypeError, match="a structure of the form f0i0b0F1i1 among such of the form f0i0b0f1i1"):
        Block((Structures([robot(), strided]),))
    for robots in (Structures([robot()]), Structures([robot()])):
        with pytest.raises(TypeError, match="among such of the form"):
            robots[0] = strided
        assert robots[0].vector.tolist() == [1.0, 2.0, 3.0], "a refused one takes no place"


def test_every_kind_of_argument_reaches_the_kernel(small):
    """Numbers by their value, arrays by their layout, the same as in Python."""
    flags = np.array([True, False])
    for matrix in (MATRIX[:2, :2].copy(), MATRIX[::2, ::3], MATRIX.T[:2, 1:3]):
        for number, whole, flag in ((0.1, -3, True), (np.float64(2.5), np.int64(4), np.False_)):
            compiled, python = np.full((2, 2), np.nan), np.full((2, 2), np.nan)
            multiply(matrix, number, whole, flag, flags, compiled)
            multiply.function(matrix, number, whole, flag, flags, python)
            assert compiled.tolist() == python.tolist()
            assert (compiled[:, 0] == (matrix[:, 0] * number * whole if flag else -1.0)).all()


@pytest.mark.parametrize(("a", "expected"), [(1.0, np.inf), (-1.0, -np.inf), (0.0, np.nan)])
def test_compiled_code_divides_by_zero_as_numpy(small, a, expected):
    out = np.zeros(1)
    divide(a, 0.0, out)
    np.testing.assert_array_equal(out, expected)


def test_a_form_that_is_not_compiled_is_refused_and_nothing_runs(small):
    """The message says which are; contiguous arrays serve where strided ones do, but not the other way round."""
    out = np.zeros((2, 2))
    for wrong in (
        (MATRIX[0], 1.0, 1, True, np.ones(2, dtype=bool), out),
        (MATRIX[:2, :2], 1.0, 1.0, True, np.ones(2, dtype=bool), out),
        (MATRIX[:2, :2], 1.0, 1, True, np.ones(4, dtype=bool)[::2], out),
        (MATRIX[:2, :2], 1.0, 1, True, np.ones(2, dtype=bool)),
    ):
        with pytest.raises(TypeError, match=r"small_kernels.multiply is not compiled .*but for f2f0i0b0b1f2, F2f0i0b0"):
            multiply(*wrong)
    assert not out.any()
    with pytest.raises(KeyError):
        kernels.Entry(lambda out: None)(out)


def test_prepared_calls_see_replaced_items_and_filled_arrays(small):
    robots, out = Structures([robot(), robot(gain=2.0)]), np.zeros(2)
    call = add_up.bind(robots, out)
    for i, replaced in ((0, robot(count=-4, flag=False)), (1, robot(gain=7.0)), (0, robot())):
        robots[i] = replaced
        robots[1].wholes[0] += 1
        call()
        expected = np.zeros(2)
        add_up.function(robots, expected)
        assert out.tolist() == expected.tolist() and out[0] != out[1]


COPIES = [copy.deepcopy, lambda original: pickle.loads(pickle.dumps(original))]


@pytest.mark.parametrize("copied", COPIES, ids=["deepcopy", "pickle"])
def test_a_copied_call_goes_to_arrays_of_its_own(small, copied):
    robots, out = Structures([robot(), robot(gain=2.0)]), np.zeros(2)
    call = add_up.bind(robots, out)
    call()
    first = out.tolist()
    other = copied(call)
    theirs, written = other.arguments
    assert other.entry is add_up and not np.shares_memory(theirs.rows, robots.rows)
    robots[1] = robot(gain=100.0)
    robots[0].wholes[:] = 0
    out[:] = -1.0
    written[:] = 0.0
    other()
    assert written.tolist() == first and out.tolist() == [-1.0, -1.0]
    theirs[0] = robot(gain=3.0)
    assert robots[0].gain == 0.5


@pytest.mark.parametrize("copied", [*COPIES, copy.copy], ids=["deepcopy", "pickle", "copy"])
def test_there_is_one_of_each_entry(copied):
    assert copied(step_range) is step_range
    assert copied(add_up) is add_up


def several():
    return SFFRFlexVectorEnv(WIDTH + 1, scenario="noise")


def different():
    return SFFRFlexVectorEnv(3, scenario="mismatch")


def damping():
    return SFFRFlexDampingVectorEnv(WIDTH + 1)


@pytest.mark.parametrize("copied", COPIES, ids=["deepcopy", "pickle"])
@pytest.mark.parametrize("make", [SFFRFlexEnv, SFFRFlexDampingEnv, several, different, damping])
def test_a_copied_environment_goes_its_own_way(make, copied):
    """Both go on as the original would have alone, whichever steps first."""
    env, alone = make(), make()
    action = np.full(env.action_space.shape, 0.2)
    for each in (env, alone):
        each.reset(seed=4)
        each.step(action)
    other = copied(env)
    before = env._batch.p.copy()
    for _ in range(3):
        theirs = other.step(-action)[0]
    np.testing.assert_array_equal(env._batch.p, before)
    ours = env.step(action)[0]
    np.testing.assert_array_equal(ours, alone.step(action)[0])
    for _ in range(3):
        expected = copied(alone).step(action)[0]
    assert expected.tolist() == env.step(action)[0].tolist() and theirs.tolist() != ours.tolist()
    assert other.reset(seed=9)[0].tolist() == alone.reset(seed=9)[0].tolist()


@pytest.mark.parametrize("copied", COPIES, ids=["deepcopy", "pickle"])
def test_copied_simulators_and_policies_work(copied):
    simulator, env = Simulator(), SFFRFlexEnv()
    state, command = simulator.initial_state(), {"base": [1.0, 0.0, 0.1]}
    other = copied(simulator)
    assert other.step(state, **command).q.tolist() == simulator.step(state, **command).q.tolist()
    assert other._plant.work is not simulator._plant.work
    policy, (obs, _) = make_policy("ahsc", env), env.reset(seed=0)
    policy(obs)
    another = copied(policy)
    assert not np.shares_memory(another.B_hat, policy.B_hat)
    assert another(obs + 0.01).tolist() == policy(obs + 0.01).tolist()


def test_entries_are_called_by_the_names_of_their_functions():
    for name, entry in ENTRIES.items():
        assert name == entry.name == f"{entry.function.__module__}.{entry.function.__name__}"
        assert entry.__doc__ and entry.__name__ == entry.function.__name__


def test_every_form_of_the_tests_own_is_found(small):
    for entry, arguments in exemplars():
        assert small.function(entry.name, Block(arguments).form)


def test_an_item_can_be_replaced_before_a_call_is_prepared():
    """As where kernels run as Python, and no call ever is; its form is compared all the same."""
    robots = Structures([robot(), robot()])
    robots[1] = robot(gain=7.0)
    assert robots[1].gain == 7.0
    with pytest.raises(TypeError, match="a structure of the form"):
        robots[0] = (1.0,)

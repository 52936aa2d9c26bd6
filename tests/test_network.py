"""Networks of learned schedules by hand: what they compute, what fits what, and what their files may hold."""

import hashlib
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from sffr_baselines.learned import LearnedSchedule, Network, file_hash, load_schedule, save_schedule
from sffr_gym import ConfigError

TWO = (np.array([[1.0, -2.0], [0.5, 1.0], [-1.0, 0.25]]), np.array([[1.0, 2.0, -1.0]]))
BIASES = (np.array([0.1, -0.2, 0.3]), np.array([0.05]))
ONE = Network((np.array([[0.5, 0.25]]),), (np.array([0.1]),), relu=True, squash=False)


def network(relu=False, squash=False, matrices=TWO, biases=BIASES):
    return Network(matrices, biases, relu, squash)


def schedule(net=None, panels=2, **changes):
    """A schedule of a network of two inputs and one output for each panel."""
    names = tuple(f"see{k}" for k in range(2 * panels)), tuple(f"do{k}" for k in range(panels))
    made = LearnedSchedule(net or network(), "ahsc", 10.0, 0.1, None, 1, *names, (5e-3, 0.04, 1e-3), {"algo": "none"})
    return replace(made, **changes)


@pytest.mark.parametrize("squash", [True, False])
@pytest.mark.parametrize("relu", [True, False])
@pytest.mark.parametrize("features", [[0.3, -0.1], [-0.4, 0.2], [0.02, 0.01], [3.0, 1.0], [-3.0, -1.0]])
def test_a_network_computes_what_its_layers_say(relu, squash, features):
    """Rectified or through tanh, number by number; the output between -1 and 1."""
    x, y = features
    hidden = [x - 2.0 * y + 0.1, 0.5 * x + y - 0.2, -x + 0.25 * y + 0.3]
    a, b, c = (max(each, 0.0) if relu else np.tanh(each) for each in hidden)
    out = a + 2.0 * b - c + 0.05
    expected = np.tanh(out) if squash else min(max(out, -1.0), 1.0)
    assert network(relu, squash)(np.array(features))[0] == pytest.approx(expected, rel=1e-12)
    many = network(relu, squash)(np.array([[features] * 3] * 2))
    assert many.shape == (2, 3, 1)
    np.testing.assert_allclose(many, expected, rtol=1e-12)


def test_a_network_of_one_or_three_layers():
    assert ONE.sizes == (2, 1) and ONE(np.array([-1.0, 0.0]))[0] == pytest.approx(-0.4)
    three = Network((*TWO, np.array([[0.5], [-0.5]])), (*BIASES, np.zeros(2)), relu=False, squash=False)
    middle = np.tanh(TWO[1] @ np.tanh(TWO[0] @ [0.3, 0.2] + BIASES[0]) + BIASES[1])[0]
    np.testing.assert_allclose(three(np.array([0.3, 0.2])), [0.5 * middle, -0.5 * middle], rtol=1e-12)
    assert three.sizes == (2, 3, 1, 2)
    np.testing.assert_array_equal(three.flat()[:9], [*TWO[0].ravel(), *BIASES[0]])
    assert len(three.flat()) == 9 + 4 + 4


@pytest.mark.parametrize(
    ("matrices", "biases", "message"),
    [
        ((), (), "at least one layer"),
        (TWO, BIASES[:1], "at least one layer"),
        ((np.zeros(2),), (np.zeros(2),), r"a matrix of shape \(2,\)"),
        ((np.zeros((1, 2, 2)),), (np.zeros(1),), r"a matrix of shape \(1, 2, 2\)"),
        ((np.zeros((1, 2)),), (np.zeros(2),), r"a bias of shape \(2,\)"),
        ((np.zeros((1, 2)),), (np.zeros((1, 2)),), r"a bias of shape \(1, 2\)"),
        ((np.zeros((1, 2)),), (np.array([np.nan]),), "not finite"),
        ((np.full((1, 2), np.inf),), (np.zeros(1),), "not finite"),
        ((TWO[0], np.zeros((1, 2))), BIASES, "a layer of 3 outputs is followed by one of 2 inputs"),
        ((*TWO, np.zeros((3, 3))), (*BIASES, np.zeros(3)), "a layer of 1 outputs is followed by one of 3 inputs"),
    ],
)
def test_layers_that_do_not_follow_on_each_other_are_no_network(matrices, biases, message):
    with pytest.raises(ConfigError, match=message):
        network(matrices=matrices, biases=biases)


@pytest.mark.parametrize("panels", [1, 2, 5])
def test_a_schedule_serves_each_panel_by_itself(panels):
    """Of one observation or many."""
    made, rows = schedule(panels=panels), np.random.default_rng(0).normal(size=(3, 2 * panels))
    actions, state = made.predict(rows)
    assert state is None and actions.dtype == np.float32
    expected = [[made.network(row[2 * k : 2 * k + 2])[0] for k in range(panels)] for row in rows]
    np.testing.assert_allclose(actions, expected, rtol=1e-6)
    np.testing.assert_array_equal(made.predict(rows[0].tolist())[0], actions[0])
    assert made.predict(rows[None])[0].shape == (1, 3, panels)


@pytest.mark.parametrize(
    "changes",
    [{"obs_names": ()}, {"action_names": ("a",)}, {"action_names": ("a", "b", "c")}, {"obs_names": ("a", "b", "c")},
     {"obs_names": ("a",), "action_names": ()}, {"obs_names": (), "action_names": ()}],
)  # fmt: skip
def test_a_network_of_other_sizes_does_not_fit(changes):
    with pytest.raises(ConfigError, match=r"a network of 2 inputs and 1 outputs does not fit \d observations"):
        schedule(**changes)


@pytest.mark.parametrize(
    ("scaling", "valid"),
    [((1e-9, 1.0, 1e6), True), ((0.0, 1.0, 1.0), False), ((1.0, -1.0, 1.0), False), ((1.0, 1.0, np.inf), False),
     ((1.0, np.nan, 1.0), False), ((1.0, 1.0), False), ((1.0,) * 4, False)],
)  # fmt: skip
def test_an_observation_is_scaled_by_three_positive_numbers(scaling, valid):
    with nullcontext() if valid else pytest.raises(ConfigError, match="must be three positive numbers"):
        assert schedule(scaling=scaling).scaling == scaling


@pytest.mark.parametrize(
    ("net", "tolerance"), [(ONE, None), (network(relu=True), 0.1), (network(squash=True), None), (network(), 2.0)]
)
def test_a_schedule_is_read_as_it_was_written(net, tolerance, tmp_path):
    save_schedule(tmp_path / "policy.npz", schedule(net, base_tolerance=tolerance))
    read = load_schedule(tmp_path / "policy.npz")
    assert replace(read, network=net) == schedule(net, base_tolerance=tolerance)
    assert (read.network.relu, read.network.squash, read.network.sizes) == (net.relu, net.squash, net.sizes)
    np.testing.assert_array_equal(read.network.flat(), net.flat())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"about": np.array(["{}"])}, "about must be a text"),
        ({"about": np.array(1.0)}, "about must be a text"),
        ({"matrix0": np.array([["a", "b"]])}, "matrix0 must hold numbers"),
        ({"bias1": np.array(["a"])}, "bias1 must hold numbers"),
        ({"more": np.zeros(1)}, "holds about, bias0, bias1, matrix0, matrix1, not about, and matrix and bias"),
        ({"matrix2": np.zeros((1, 1))}, "holds .*, not about, and matrix and bias"),
        ({"matrix3": np.zeros((1, 1)), "bias3": np.zeros(1)}, "holds .*, not about, and matrix and bias"),
    ],
)
def test_a_file_of_other_arrays_is_no_policy(changes, message, tmp_path):
    file = tmp_path / "policy.npz"
    save_schedule(file, schedule())
    with np.load(file) as kept:
        arrays = dict(kept)
    np.savez(file, **(arrays | changes))
    with pytest.raises(ConfigError, match=rf"policy\.npz: is not a policy of sffr-policy-1: {message}"):
        load_schedule(file)


def test_a_hash_is_the_beginning_of_the_files_sha256(tmp_path):
    """Of a file of at most 32 MB, as large as a policy may be."""
    content = b"weights".ljust(32_000_000)
    (tmp_path / "largest").write_bytes(content)
    assert file_hash(tmp_path / "largest") == hashlib.sha256(content).hexdigest()[:16]
    (tmp_path / "larger").write_bytes(content + b" ")
    with pytest.raises(ConfigError, match="larger"):
        file_hash(tmp_path / "larger")

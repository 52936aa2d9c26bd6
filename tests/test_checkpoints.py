"""Checkpoints of others: each damage is told in one line, changes nothing, and gives way to an earlier checkpoint."""

import json
import os
import random
import shutil

import numpy as np
import pytest
from small_training import assert_same, small, weights

from sffr_agents import snapshot
from sffr_agents.algorithms import make_model
from sffr_agents.checkpoint import ARRAYS, MOST_STATE, STATE, Notes, load_checkpoint, save_checkpoint
from sffr_agents.folder import BEST, CHECKPOINTS, LAST, PROGRESS, SECONDS
from sffr_agents.plain import decode, encode
from sffr_agents.progress import read_progress
from sffr_agents.train import resume, train
from sffr_gym import ConfigError

KEPT = Notes(saved=40, scores={"cost": 1.0}, best_scores={"cost": 0.5}, pending=(("loss", 0.25, ("tensorboard",)),))


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A trained SAC, which has a replay buffer and an entropy coefficient, its environments, and its checkpoint."""
    model, env = make_model(small("sac"), seed=0)
    model.learn(80)
    folder = tmp_path_factory.mktemp("checkpoints")
    save_checkpoint(folder, model, env, KEPT, keep=1)
    return model, env, folder / "000001"


@pytest.fixture
def checkpoint(trained, tmp_path):
    """A copy of the checkpoint that a test may change."""
    return shutil.copytree(trained[2], tmp_path / CHECKPOINTS / "000001")


def edit_state(checkpoint, change):
    file = checkpoint / STATE
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))


def at(data, path):
    """What stands at a path of an encoded state; mappings are within ``items``."""
    value = data["state"]
    for part in path.split("/"):
        value = value[int(part)] if isinstance(value, list) else value["items"][part]
    return value


def put(path, value):
    """A change that puts a value at a path of the state."""

    def change(checkpoint):
        def edit(data):
            above, _, name = path.rpartition("/")
            owner = at(data, above) if above else data["state"]
            owner[int(name) if isinstance(owner, list) else name] = value
            if not isinstance(owner, list):
                owner["items"][name] = owner.pop(name)

        edit_state(checkpoint, edit)

    return change


def without(path):
    """A change that takes a key of the state away."""

    def edit(data):
        above, _, name = path.rpartition("/")
        del (at(data, above) if above else data["state"])["items"][name]

    return lambda checkpoint: edit_state(checkpoint, edit)


def array(path, change):
    """A change of the array at a path of the state."""

    def edit(checkpoint):
        name = at(json.loads((checkpoint / STATE).read_text()), path)["array"]
        with np.load(checkpoint / ARRAYS) as arrays:
            changed = dict(arrays)
        changed[name] = change(changed[name])
        np.savez(checkpoint / ARRAYS, **changed)

    return edit


def generator(**changes):
    """A change of the state of the generator that actions are drawn from."""

    def edit(data):
        state = at(data, "generators/actions")["generator"]
        for name, value in changes.items():
            (state if name in state else state["state"])[name] = value

    return lambda checkpoint: edit_state(checkpoint, edit)


def notes(**changes):
    """A change of what the training wants to know again."""
    encoded = encode(changes, {})["items"]
    return lambda checkpoint: edit_state(checkpoint, lambda data: data["notes"]["items"].update(encoded))


def text(content):
    """A change of the whole state's file."""
    return lambda checkpoint: (checkpoint / STATE).write_bytes(content)


def cut(name):
    """Half of a file."""
    return lambda checkpoint: os.truncate(checkpoint / name, (checkpoint / name).stat().st_size // 2)


def gone(name):
    """No such file."""
    return lambda checkpoint: (checkpoint / name).unlink()


def shared(checkpoint):
    """Two names for one array, so that a change of the one would change the other."""
    edit_state(checkpoint, lambda data: at(data, "environments/batch").__setitem__(2, at(data, "environments/batch/1")))


def pickled(values):
    """An array that would have to be unpickled."""
    return np.array([{}], dtype=object)


DAMAGES = {
    "state cut": (cut(STATE), "is no valid JSON"),
    "state empty": (text(b""), "is no valid JSON"),
    "state of another encoding": (text(b"\xff\xfe{"), "is not text in UTF-8"),
    "state a list": (text(b"[]"), "must hold a mapping"),
    "state nested": (text(b"[" * 100_000), "is nested too deeply"),
    "state nested within": (
        lambda c: edit_state(c, lambda data: data.update(state=json.loads('{"items":{"a":' * 300 + "1" + "}}" * 300))),
        "is nested too deeply",
    ),
    "state too large": (lambda c: os.truncate(c / STATE, MOST_STATE + 1), "is too large"),
    "state not there": (gone(STATE), "cannot be read"),
    "no format": (lambda c: edit_state(c, lambda data: data.pop("format")), "format: missing"),
    "format of others": (lambda c: edit_state(c, lambda data: data.update(format="x")), "must be 'sffr-checkpoint-1'"),
    "more than a checkpoint": (lambda c: edit_state(c, lambda data: data.update(code="x")), "code: unknown key"),
    "arrays cut": (cut(ARRAYS), "is no .npz file of plain arrays"),
    "arrays not there": (gone(ARRAYS), "cannot be read"),
    "arrays a folder": (lambda c: (gone(ARRAYS)(c), (c / ARRAYS).mkdir()), "cannot be read"),
    "arrays more than fit": (lambda c: os.truncate(c / ARRAYS, 10**8), "is too large"),
    "array shorter": (array("environments/batch/1", lambda v: v[:1]), "must have the shape"),
    "array of another type": (array("environments/batch/0", lambda v: v.astype(np.float64)), "must be of type int64"),
    "time beyond": (array("environments/batch/0", lambda v: v + 10**12), "state.batch.tick: must lie in its range"),
    "plant of another robot": (array("environments/fleet/1", lambda v: v + 1), "is of another robot than this"),
    "array pickled": (array("last/0", pickled), "must hold numbers or texts"),
    "array not there": (put("last/0", {"array": "none"}), "must be an array, is NoneType"),
    "array shared": (shared, "must be an array, is NoneType"),
    "state no mapping": (lambda c: edit_state(c, lambda data: data.update(state=7)), "position"),
    "kind of value unknown": (put("counters", {"code": "x"}), "'code' is no kind of value"),
    "kinds of values mixed": (put("counters", {"array": "a0", "items": {}}), "must have one of"),
    "number that is none": (put("progress", {"number": "one"}), "'number' is no kind of value"),
    "no networks": (without("networks"), "has no 'networks'"),
    "no batch": (without("environments/batch"), "has no 'batch'"),
    "more than a state": (put("code", "x"), "has 'code', which is unknown"),
    "weights of another shape": (array("networks/actor.mu.weight", lambda v: v[:, :3]), "must have the shape (2, 8)"),
    "weights of another network": (without("networks/actor.mu.bias"), "has no 'actor.mu.bias'"),
    "weights not finite": (array("networks/actor.mu.bias", lambda v: v * np.nan), "actor.mu.bias: must be finite"),
    "moments not finite": (
        array("optimizers/actor.optimizer/0/exp_avg", lambda v: v + np.inf),
        "0.exp_avg: must be finite",
    ),
    "moments of no parameter": (
        lambda c: edit_state(c, lambda d: at(d, "optimizers/actor.optimizer")["items"].update({"99": {"items": {}}})),
        "has '99', which is unknown",
    ),
    "moments missing": (without("optimizers/actor.optimizer/0/exp_avg"), "has no 'exp_avg'"),
    "variable gone": (without("variables/log_ent_coef"), "has no 'log_ent_coef'"),
    "rows of another batch": (put("monitor", []), "must have 2 entries, has 0"),
    "observation not finite": (array("last/0", lambda v: v * np.nan), "last.0: must be finite"),
    "count negative": (put("counters/num_timesteps", -1), "counters.num_timesteps = -1: must be from 0"),
    "count huge": (put("counters/_n_updates", 10**400), "counters._n_updates"),
    "count a switch": (put("counters/_n_updates", True), "counters._n_updates = True"),
    "count a fraction": (put("counters/_n_updates", 1.5), "must be of type int"),
    "progress infinite": (put("progress", {"number": "-inf"}), "progress = -inf"),
    "position beyond the buffer": (put("position/0", 10**6), "position.0 = 1000000: must be from 0 to"),
    "position negative": (put("position/0", -1), "position.0 = -1: must be from 0"),
    "position no pair": (put("position", [1, False, 2]), "position: must have 2 entries"),
    "buffer not as full": (put("position/1", True), "state.replay.0: must have the shape"),
    "buffer gone": (put("replay", []), "state.replay: must have 6 entries"),
    "Python's words too few": (array("generators/python/0", lambda v: v[:600]), "must have the shape (625,)"),
    "Python's position": (array("generators/python/0", lambda v: np.append(v[:624], np.uint32(700))), "invalid state"),
    "Python's spare number": (put("generators/python/1", "x"), "generators.python.1"),
    "NumPy's generator": (put("generators/numpy/0", "PCG64"), "must be 'MT19937'"),
    "NumPy's position": (put("generators/numpy/2", 625), "generators.numpy.2 = 625: must be from 0 to 624"),
    "NumPy's position negative": (put("generators/numpy/2", -1), "generators.numpy.2 = -1"),
    "NumPy's spare number": (put("generators/numpy/3", 7), "generators.numpy.3 = 7: must be from 0 to 1"),
    "torch's state": (array("generators/torch", np.zeros_like), "is no state of torch's generator"),
    "torch's state cut": (array("generators/torch", lambda v: v[:9]), "must have the shape"),
    "generator of another kind": (generator(bit_generator="MT19937"), "none of PCG64"),
    "generator's state beyond": (generator(inc=2**128 + 1), "none of PCG64"),
    "generator's state a text": (generator(uinteger="x"), "none of PCG64"),
    "generator's step even": (generator(inc=2), "none of PCG64"),
    "generator's switch": (generator(has_uint32=5), "none of PCG64"),
    "generator no mapping": (put("generators/actions", {"generator": [1]}), "none of PCG64"),
    "notes no mapping": (lambda c: edit_state(c, lambda data: data.update(notes=[])), "notes: must be a mapping"),
    "notes negative": (notes(saved=-1), "saved = -1"),
    "notes without costs": (notes(scores={"nominal/cost": 1.0}), "has scores without 'cost'"),
    "notes without a best": (notes(best_scores={}), "has either scores or best_scores"),
    "notes of others": (notes(code="x"), "code: unknown key"),
    "time negative": (notes(elapsed=-1.0), "elapsed = -1"),
    "episodes too many": (notes(episodes=[[1.0, 1]] * 101), "episodes"),
    "waiting for the log": (notes(pending=[["loss", "x", []]]), "pending"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_checkpoint_is_told_and_changes_nothing(damage, trained, checkpoint):
    change, message = DAMAGES[damage]
    change(checkpoint)
    model, env, _ = trained
    generators = random.getstate(), np.random.get_state()[1].tobytes()  # noqa: NPY002
    arrays: dict[str, np.ndarray] = {}
    before = encode(snapshot.take(model, env), arrays)
    with pytest.raises(ConfigError) as error:
        load_checkpoint(checkpoint.parent, model, env)
    assert message in str(error.value) and len(str(error.value).splitlines()) == 1
    assert str(error.value).startswith(str(checkpoint)) and len(str(error.value)) < 500
    after: dict[str, np.ndarray] = {}
    assert encode(snapshot.take(model, env), after) == before
    assert_same(arrays, after)
    assert generators == (random.getstate(), np.random.get_state()[1].tobytes())  # noqa: NPY002


def test_checkpoint_is_put_back_as_it_was(trained):
    """Into a training that has gone on, and into a new one; weights that are trained and those that are not yet."""
    model, env, checkpoint = trained
    for other in make_model(small("sac"), seed=5), (model, env):
        assert load_checkpoint(checkpoint.parent, *other) == KEPT
        arrays: dict[str, np.ndarray] = {}
        state = encode(snapshot.take(*other), arrays)
        assert state == json.loads((checkpoint / STATE).read_text())["state"]
        with np.load(checkpoint / ARRAYS) as saved:
            assert_same(dict(saved), arrays)
    untrained = make_model(small("sac"), seed=6)
    save_checkpoint(checkpoint.parents[1], *untrained, Notes(), keep=1)
    assert load_checkpoint(checkpoint.parents[1], *untrained) == Notes()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -0.0, 5e-324, (1, [2, {"a": None}]), 2**127, True])
def test_values_come_back_as_they_were(value):
    arrays: dict[str, np.ndarray] = {}
    saved = json.loads(json.dumps(encode(value, arrays), allow_nan=False))
    assert repr(decode(saved, value, arrays)) == repr(value)


def test_random_bytes_are_never_more_than_an_error(trained, checkpoint):
    """A hundred checkpoints with a few bytes changed anywhere: an error in a line, or taken."""
    model, env, original = trained
    rng = np.random.default_rng(0)
    refused = 0
    for trial in range(100):
        name = (STATE, ARRAYS)[trial % 2]
        content = bytearray((original / name).read_bytes())
        for place in rng.integers(len(content), size=3):
            content[place] = rng.integers(256)
        (checkpoint / name).write_bytes(content)
        try:
            load_checkpoint(checkpoint.parent, model, env)
        except ConfigError as error:
            assert str(error).startswith(str(checkpoint)) and len(str(error).splitlines()) == 1
            refused += 1
        shutil.copy(original / name, checkpoint / name)
    assert refused > 80
    assert load_checkpoint(checkpoint.parent, model, env) == KEPT


def leave_two(folder, config):
    """A training that was killed after two checkpoints."""

    class Killed(Exception):
        pass

    def report(done, total, scores):
        if len(list((folder / CHECKPOINTS).glob("[0-9]*"))) == 2:
            raise Killed

    with pytest.raises(Killed):
        train(config, 3, folder, report)
    return sorted((folder / CHECKPOINTS).iterdir())


def assert_same_end(whole, other):
    assert_same(weights(whole), weights(other))
    for name in (BEST, LAST):
        assert (whole / name).read_bytes() == (other / name).read_bytes()
    tables = [read_progress(folder / PROGRESS) for folder in (whole, other)]
    first, second = ([row | {SECONDS: ""} for row in table] for table in tables)
    assert first == second


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_damaged_checkpoint_gives_way_to_an_earlier_one(algo, tmp_path):
    """Which is told, and ends with the same policies and the same log."""
    config = small(algo, "validation.every=70")
    train(config, 3, tmp_path / "whole")
    earlier, last = leave_two(tmp_path / "killed", config)
    os.truncate(last / ARRAYS, 1000)
    told: list[str] = []
    resume(tmp_path / "killed", tell=told.append)
    assert len(told) == 1 and str(last) in told[0] and f"; {earlier.name} is taken" in told[0]
    assert_same_end(tmp_path / "whole", tmp_path / "killed")
    last = sorted((tmp_path / "killed" / CHECKPOINTS).iterdir())[-1]
    with pytest.warns(UserWarning, match=f"{last.name}.*is taken, an earlier checkpoint"):  # also once it is finished
        os.truncate(last / STATE, 10)
        resume(tmp_path / "killed")
    assert_same_end(tmp_path / "whole", tmp_path / "killed")


def test_without_a_whole_checkpoint_each_damage_is_told(tmp_path):
    for checkpoint in leave_two(tmp_path, small("ppo")):
        os.truncate(checkpoint / STATE, 10)
    with pytest.raises(ConfigError) as error:
        resume(tmp_path)
    assert len(str(error.value).splitlines()) == 2


def test_only_checkpoints_of_ours_are_removed(trained):
    """Whatever else lies among them, under names such as ours give too, stays; theirs do not count."""
    model, env, checkpoint = trained
    folder = checkpoint.parent.parent / "mixed"
    for name in ("999999", "000007", "unfinished", ".000001.1", "data"):
        (folder / name).mkdir(parents=True)
        (folder / name / "thesis.csv").write_text("mine")
    (folder / "000002").write_text("mine")
    (folder / "elsewhere").mkdir()
    shutil.copytree(checkpoint, folder / "elsewhere" / "000001")
    (folder / "000003").symlink_to(folder / "elsewhere" / "000001")
    shutil.copytree(checkpoint, folder / ".000004.77")  # a killed process's
    before = {path.relative_to(folder) for path in folder.rglob("*")}
    for _ in range(9):
        save_checkpoint(folder, model, env, KEPT, keep=2)
    after = {path.relative_to(folder) for path in folder.rglob("*")}
    gone = {path for path in before if path.parts[0] == ".000004.77"}
    assert before - after == gone and gone
    assert {path.parts[0] for path in after - before} == {"000011", "000012"}  # of 1, 4, 5, 6 and 8 to 12

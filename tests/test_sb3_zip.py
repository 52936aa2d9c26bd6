"""Zips of Stable-Baselines3 from others: their weights are read as plain arrays, whatever else they hold or claim."""

import io
import os
import pickle
import struct
import subprocess
import sys
import zipfile
from collections import OrderedDict

import numpy as np
import pytest
import torch
from command_line import sffr
from small_training import PPO_SMALL, small
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from sffr_agents import sb3_zip
from sffr_agents.algorithms import make_model
from sffr_agents.config import CONFIGS, load_config
from sffr_agents.export import export_zip, network_of
from sffr_agents.sb3_zip import WEIGHTS, read_weights
from sffr_gym import ConfigError


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A zip of Stable-Baselines3, and its model."""
    model, _ = make_model(small("ppo"), seed=0)
    file = tmp_path_factory.mktemp("saved") / "model.zip"
    model.save(file)
    return file, model


def members(content):
    """The members of a zip archive."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(contents, method=zipfile.ZIP_STORED):
    """A zip archive of these members."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method, compresslevel=1) as archive:
        for name, content in contents.items():
            archive.writestr(name, content)
    return file.getvalue()


def model_zip(weights, method=zipfile.ZIP_STORED):
    return packed({"data": b"{}", WEIGHTS: weights}, method)


def of_torch(value):
    """What torch writes for a value."""
    file = io.BytesIO()
    torch.save(value, file)
    return file.getvalue()


def weights_with(pickled, numbers=b"\0" * 4):
    """A torch archive with any pickle, and four bytes as numbers."""
    return packed({"archive/data.pkl": pickled, "archive/data/0": numbers, "archive/byteorder": b"little"})


def tensor(shape=(1,), strides=(1,), offset=0, count=1, dtype=b"FloatStorage", name=b"0"):
    """A pickle of a mapping of one tensor, as torch writes it."""
    integer = lambda value: b"\x8a\x09" + value.to_bytes(9, "little", signed=True)  # noqa: E731
    numbers = b"(" + b"".join(map(integer, shape)) + b"t", b"(" + b"".join(map(integer, strides)) + b"t"
    storage = b"(X\x07\0\0\0storagectorch\n" + dtype + b"\nX" + struct.pack("<I", len(name)) + name
    storage += b"X\x03\0\0\0cpu" + integer(count) + b"tQ"
    value = b"ctorch._utils\n_rebuild_tensor_v2\n(" + storage + integer(offset) + numbers[0] + numbers[1] + b"\x89NtR"
    return b"\x80\x02}X\x01\0\0\0a" + value + b"s."


class Code:
    def __reduce__(self):
        return (os.system, ("touch /tmp/sffr-was-run",))


DEEP = b"\x80\x02})" + b"q\1h\1\x86" * 60 + b"Ns."  # a pair of a pair of a pair, each of the same twice
FILES = {
    "empty": (b"", "File is not a zip file"),
    "text": (b"weights", "File is not a zip file"),
    "no weights": (packed({"data": b"{}"}), "it has no policy.pth"),
    "weights no archive": (model_zip(b"x" * 100), "File is not a zip file"),
    "weights of an old torch": (model_zip(pickle.dumps({"a": 1})), "File is not a zip file"),
    "bomb": (model_zip(bytes(200_000_000), zipfile.ZIP_DEFLATED), "has 200.0 MB, at most 100.0 MB"),
    "bomb within": (model_zip(packed({"a/data.pkl": bytes(200_000_000)}, zipfile.ZIP_DEFLATED)), "at most 100.0 MB"),
    "bomb of bzip2": (model_zip(bytes(1000), zipfile.ZIP_BZIP2), "is compressed by method 12"),
    "many members": (packed({f"{k}": b"" for k in range(5000)}), "5000 members, at most 4096"),
    "long pickle": (model_zip(weights_with(b"N" * 2_000_000 + b".")), "has 2.0 MB, at most 1.0 MB"),
    "no pickle": (model_zip(packed({"archive/data/0": b""})), "has no data.pkl"),
    "other order of bytes": (
        model_zip(packed({"archive/data.pkl": b"", "archive/byteorder": b"big"})),
        "another order of bytes",
    ),
    "pickle cut": (model_zip(weights_with(tensor()[:-3])), "or is damaged: EOFError"),
    "code": (model_zip(weights_with(pickle.dumps(Code(), 2))), "it has 'posix.system', which is no part of weights"),
    "code of torch": (model_zip(weights_with(b"\x80\x02ctorch\nTensor\n\x8a\x05\0\0\0\0\x7f\x85R.")), "'torch.Tensor'"),
    "memory of the pickle": (model_zip(weights_with(b"\x80\x04\x96" + struct.pack("<Q", 2**33) + b".")), "KeyError"),
    "memo": (model_zip(weights_with(b"\x80\x02}r\xff\xff\xff\xff0N.")), "KeyError"),
    "copies of a mapping": (model_zip(weights_with(b"\x80\x02ccollections\nOrderedDict\n}\x85R.")), "TypeError"),
    "keys that take forever": (model_zip(weights_with(DEEP)), "a key that is no text"),
    "key no text": (model_zip(weights_with(b"\x80\x02}K\1K\2s.")), "a key that is no text"),
    "a list": (model_zip(weights_with(b"\x80\x02N.")), "is no mapping of names to tensors"),
    "value no tensor": (model_zip(weights_with(b"\x80\x02}X\1\0\0\0aK\1s.")), "is no mapping of names to tensors"),
    "numbers fewer than announced": (model_zip(weights_with(tensor(count=10**9))), "1000000000 numbers are announced"),
    "numbers of another size": (model_zip(weights_with(tensor(), b"\0" * 6)), "multiple of element size"),
    "numbers not there": (model_zip(weights_with(tensor(name=b"1"))), "KeyError"),
    "numbers of no type": (model_zip(weights_with(tensor(dtype=b"UntypedStorage"))), "'torch.UntypedStorage'"),
    "tensor beyond its numbers": (model_zip(weights_with(tensor((2,), (1,)))), "a tensor of 2 numbers, of which 1"),
    "tensor after its numbers": (model_zip(weights_with(tensor(offset=5))), "a tensor of 1 numbers, of which 0"),
    "tensor before its numbers": (model_zip(weights_with(tensor(offset=-1))), "no numbers of a tensor"),
    "tensor of one number": (model_zip(weights_with(tensor((10**6, 50), (0, 0)))), "a tensor with the strides"),
    "tensor of too many numbers": (model_zip(weights_with(tensor((2**62, 4), (4, 1)))), "no numbers of a tensor"),
    "tensor of many axes": (model_zip(weights_with(tensor((1,) * 1000, (1,) * 1000))), "without numbers, shape"),
}


@pytest.mark.parametrize("name", FILES)
def test_what_is_no_zip_of_weights_is_told_in_a_line(name, tmp_path):
    content, message = FILES[name]
    (tmp_path / "model.zip").write_bytes(content)
    with pytest.raises(ConfigError) as error:
        read_weights(tmp_path / "model.zip")
    assert message in str(error.value) and str(error.value).startswith(
        f"{tmp_path / 'model.zip'}: is no zip of Stable-B"
    )
    assert len(str(error.value).splitlines()) == 1 and len(str(error.value)) < 500


def test_the_mapping_of_these_tests_is_one():
    """Else every tensor of theirs would be refused for nothing."""
    found = sb3_zip._Unpickler(tensor((1, 1), (1, 1)), lambda *_: sb3_zip._Storage(np.ones(1, np.float32))).load()
    assert found == {"a": [[1.0]]}


@pytest.mark.parametrize("algo", CONFIGS)
@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_weights_are_those_of_the_model(algo, method, tmp_path):
    model, _ = make_model(small(algo), seed=0)
    model.save(tmp_path / "model.zip")
    content = packed(members((tmp_path / "model.zip").read_bytes()), method)
    (tmp_path / "model.zip").write_bytes(content)
    weights, own = read_weights(tmp_path / "model.zip"), model.policy.state_dict()
    assert weights.keys() == own.keys()
    for name, array in weights.items():
        assert array.dtype == own[name].numpy().dtype and np.array_equal(array, own[name].numpy())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda own: {}, "policy: has no"),
        (lambda own: own | {"code": torch.ones(1)}, "has 'code', which is unknown"),
        (lambda own: own | {"log_std": torch.ones(3)}, "policy.log_std: must have the shape (2,), has (3,)"),
        (lambda own: own | {"log_std": torch.ones(2).double()}, "policy.log_std: must be of type float32"),
        (lambda own: own | {"action_net.0.bias": torch.full((2,), np.nan)}, "weights that are not finite"),
    ],
)
def test_weights_that_do_not_fit_are_named(change, message, saved, tmp_path):
    (tmp_path / "model.zip").write_bytes(model_zip(of_torch(OrderedDict(change(saved[1].policy.state_dict())))))
    with pytest.raises(ConfigError) as error:
        export_zip(tmp_path / "model.zip", small("ppo"), tmp_path / "a.npz")
    assert message in str(error.value) and str(error.value).startswith(str(tmp_path / "model.zip"))
    assert not (tmp_path / "a.npz").exists()


def test_weights_shared_by_names_and_transposed(tmp_path):
    """Names may share numbers; numbers in another order are refused, not read in the wrong one."""
    numbers = torch.arange(6.0)
    shared = {"a": numbers[1:3], "b": numbers.reshape(2, 3), "c": numbers[0]}
    (tmp_path / "a.zip").write_bytes(model_zip(of_torch(shared)))
    found = read_weights(tmp_path / "a.zip")
    assert found["a"].tolist() == [1.0, 2.0] and found["b"].tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    assert found["c"].shape == () and found["c"] == 0.0
    (tmp_path / "a.zip").write_bytes(model_zip(of_torch({"b": numbers.reshape(2, 3).T})))
    with pytest.raises(ConfigError, match=r"a tensor with the strides \(1, 3\)"):
        read_weights(tmp_path / "a.zip")


def test_features_that_are_not_the_observation_are_refused(saved):
    """A network behind them would get what it has never seen."""

    class Features(BaseFeaturesExtractor):
        pass

    model, _ = make_model(small("ppo"), seed=0)
    model.policy.features_extractor = Features(model.observation_space, 7)
    with pytest.raises(ValueError, match="a policy with a Features cannot be exported"):
        network_of(model)


@pytest.mark.parametrize("content", [b"", b"zip", model_zip(b"x")])
def test_trusted_zip_that_is_damaged_is_told_in_a_line(content, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.zip").write_bytes(content)
    for options in [], ["--trust"]:
        result = sffr("export", "model.zip", *options, "--out", "a.npz")
        assert result.exit_code == 2 and "model.zip: " in result.stderr and len(result.stderr.splitlines()) == 1
    result = sffr("export", "nowhere.zip", "--trust", "--out", "a.npz")
    assert "nowhere.zip: cannot be read" in result.stderr


def test_random_bytes_are_never_more_than_an_error(saved, tmp_path):
    rng = np.random.default_rng(0)
    original = members(saved[0].read_bytes())[WEIGHTS]
    inner = members(original)
    place = next(name for name in inner if name.endswith("data.pkl"))
    refused = 0
    for trial in range(300):
        content = bytearray(inner[place])
        for position in rng.integers(len(content), size=1 + trial % 3):
            content[position] = rng.integers(256)
        (tmp_path / "model.zip").write_bytes(model_zip(packed(inner | {place: bytes(content)})))
        try:
            read_weights(tmp_path / "model.zip")
        except ConfigError as error:
            assert len(str(error).splitlines()) == 1 and len(str(error)) < 500
            refused += 1
    assert 100 < refused < 300


MEMORY = """
import resource, sys
from pathlib import Path
from sffr_agents.sb3_zip import read_weights
from sffr_gym import ConfigError
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    read_weights(Path(sys.argv[1]))
except ConfigError:
    pass
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


@pytest.mark.parametrize("kind", ["members", "pickle"])
def test_hostile_megabytes_stay_megabytes(kind, tmp_path):
    """47 MB of the smallest members that an archive can have, and a pickle of a million empty mappings."""
    entry = b"PK\1\2" + bytes(24) + struct.pack("<H", 0) + bytes(16)
    directory = entry * (47_000_000 // len(entry))
    end = b"PK\5\6" + bytes(4) + struct.pack("<HHIIH", 0xFFFF, 0xFFFF, len(directory), 0, 0)
    contents = {"members": directory + end, "pickle": model_zip(weights_with(b"\x80\x02" + b"}" * 999_000 + b"."))}
    (tmp_path / "model.zip").write_bytes(contents[kind])
    done = subprocess.run([sys.executable, "-c", MEMORY, tmp_path / "model.zip"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 300.0


def test_export_says_which_configuration(saved, tmp_path):
    """A zip of another network than the shipped one."""
    result = sffr("export", saved[0], "--algo", "ppo", "--out", tmp_path / "a.npz")
    found = "does not fit the configuration: policy: has 'mlp_extractor.policy_net.2.weight', which is unknown"
    assert result.exit_code == 2 and found in result.stderr
    assert load_config("ppo").network.hidden != load_config("ppo", PPO_SMALL).network.hidden

"""The weights in a zip of Stable-Baselines3, read as plain arrays: nothing of the file is run, nothing is expanded.

``policy.pth`` in the zip is an archive of torch: ``data.pkl`` pickles a mapping of names to tensors, whose numbers lie
in members of their own. Of pickle's instructions only those are followed that such a mapping consists of; a tensor is
made of the bytes that are there, never of as many as the file claims.
"""

from __future__ import annotations

import functools
import io
import pickle
import zipfile
from collections.abc import Callable
from math import prod
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from sffr_gym.config.reading import open_archive, parse_json, read_bytes, read_member
from sffr_gym.config.strict_yaml import ConfigError

T = TypeVar("T")
WEIGHTS = "policy.pth"  # all networks together
DATA = "data"  # settings as JSON, pickles as texts among them
MOST_ZIP = 400_000_000  # bytes; optimisers, which are not read, take twice the weights
MOST_WEIGHTS = 100_000_000  # bytes; 25 million weights
MOST_DATA = 30_000_000  # bytes; a plain one has 50,000
MOST_PICKLE = 1_000_000  # bytes; that of the shipped configurations has 3,000
MOST_AXES = 8  # of a tensor
TYPES = {
    "FloatStorage": "<f4", "DoubleStorage": "<f8", "HalfStorage": "<f2", "LongStorage": "<i8", "IntStorage": "<i4",
    "ShortStorage": "<i2", "CharStorage": "i1", "ByteStorage": "u1", "BoolStorage": "?",
}  # fmt: skip
INSTRUCTIONS = (
    pickle.PROTO, pickle.STOP, pickle.MARK, pickle.GLOBAL, pickle.REDUCE, pickle.BINPERSID, pickle.EMPTY_TUPLE,
    pickle.TUPLE, pickle.TUPLE1, pickle.TUPLE2, pickle.TUPLE3, pickle.SETITEM, pickle.SETITEMS, pickle.BINUNICODE,
    pickle.NONE, pickle.NEWTRUE, pickle.NEWFALSE, pickle.BININT, pickle.BININT1, pickle.BININT2, pickle.LONG1,
    pickle.BINPUT, pickle.LONG_BINPUT, pickle.BINGET, pickle.LONG_BINGET,
)  # fmt: skip


def read_weights(file: Path) -> dict[str, np.ndarray]:
    """Return all weights of a model's networks by their names.

    Raises:
        ConfigError: if the file cannot be read, is too large, or is damaged or anything else.
    """

    def tensors(content: bytes) -> dict[str, np.ndarray]:
        with open_archive(content, MOST_WEIGHTS) as archive:
            return _read_tensors(archive)

    return _member(file, WEIGHTS, MOST_WEIGHTS, tensors)


def read_data(file: Path) -> dict[str, Any]:
    """Return what a zip says of its model, as plain values; what is pickled stays a text.

    Raises:
        ConfigError: if the file cannot be read, is too large, or is damaged or anything else.
    """
    found = _member(file, DATA, MOST_DATA, lambda content: parse_json(content.decode("utf-8"), DATA))
    if not isinstance(found, dict):
        raise ConfigError(f"{file}: is no zip of Stable-Baselines3: its {DATA} is no mapping")
    return found


def _member(file: Path, name: str, most: int, read: Callable[[bytes], T]) -> T:
    """Return what ``read`` makes of a member of a zip, of so many bytes at most; raises ConfigError."""
    content = read_bytes(file, MOST_ZIP)
    try:
        with open_archive(content, MOST_ZIP) as archive:
            if name not in archive.namelist():
                raise ValueError(f"it has no {name}")
            return read(_read(archive, archive.getinfo(name), most))
    except Exception as error:  # zipfile, zlib and pickle have no common error for damaged bytes
        raise ConfigError(f"{file}: is no zip of Stable-Baselines3, or is damaged: {first_line(error)}") from None


def first_line(error: Exception) -> str:
    """Return what is wrong in a short line; the kind of error where its text is for developers."""
    known = isinstance(error, ValueError | zipfile.BadZipFile | pickle.UnpicklingError | RuntimeError)
    text = (str(error).splitlines() or [""])[0][:200]
    return text if known and text else type(error).__name__


class _Storage(NamedTuple):
    """Numbers of which tensors are made."""

    numbers: np.ndarray  #: (n,)


class _Mapping(dict[str, Any]):
    """A mapping with texts as keys; others may take forever to compare."""

    def __setitem__(self, key: Any, value: Any) -> None:
        if not isinstance(key, str):
            raise ValueError("a key that is no text")
        super().__setitem__(key, value)


def _mapping() -> _Mapping:
    """Return an empty mapping; one with arguments would be a copy."""
    return _Mapping()


class _Unpickler(pickle._Unpickler):
    """An interpreter of the few instructions that make a mapping of tensors.

    Args:
        content: of ``data.pkl``.
        storage: returns the numbers of a name as a type, if they are as many as announced.
    """

    dispatch = {instruction[0]: pickle._Unpickler.dispatch[instruction[0]] for instruction in INSTRUCTIONS} | {
        pickle.EMPTY_DICT[0]: lambda self: self.append(_Mapping()),
        pickle.BUILD[0]: lambda self: self.stack.pop(),  # the attributes of a mapping, which no weight is among
    }

    def __init__(self, content: bytes, storage: Callable[[str, str, int], _Storage]) -> None:
        super().__init__(io.BytesIO(content))
        self._storage = storage

    def find_class(self, module: str, name: str) -> Any:
        """Return what stands for a class or function of torch; raises ValueError for all others."""
        if (module, name) == ("collections", "OrderedDict"):
            return _mapping
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _tensor
        if module == "torch" and name in TYPES:
            return TYPES[name]
        raise ValueError(f"it has {f'{module}.{name}'[:60]!r}, which is no part of weights")

    def persistent_load(self, pid: Any) -> _Storage:
        """Return the numbers that a tensor is made of."""
        match pid:
            case ("storage", str(dtype), str(name), str(), int(count)):
                return self._storage(name, dtype, count)
        raise ValueError("it refers to numbers in a way that is not torch's")


def _read_tensors(archive: zipfile.ZipFile) -> dict[str, np.ndarray]:
    """Return the tensors of torch's archive; raises ValueError, beside what the parsers raise."""
    members = {member.filename.partition("/")[2]: member for member in archive.infolist()}
    if "data.pkl" not in members:
        raise ValueError(f"{WEIGHTS} has no data.pkl")
    if "byteorder" in members and _read(archive, members["byteorder"], 16) != b"little":
        raise ValueError(f"{WEIGHTS} has another order of bytes")

    @functools.cache
    def numbers_of(name: str) -> bytes:
        return _read(archive, members[f"data/{name}"], MOST_WEIGHTS)

    def storage(name: str, dtype: str, count: int) -> _Storage:
        numbers = np.frombuffer(numbers_of(name), dtype)
        if len(numbers) != count:
            raise ValueError(f"{count} numbers are announced, {len(numbers)} are there")
        return _Storage(numbers)

    found = _Unpickler(_read(archive, members["data.pkl"], MOST_PICKLE), storage).load()
    if not (isinstance(found, dict) and all(isinstance(value, np.ndarray) for value in found.values())):
        raise ValueError(f"{WEIGHTS} is no mapping of names to tensors")
    return dict(found)


def _read(archive: zipfile.ZipFile, member: zipfile.ZipInfo, most: int) -> bytes:
    """Return the content of a member of limited size."""
    if member.file_size > most:
        raise ValueError(f"{member.filename[:60]!r} has {member.file_size / 1e6:,.1f} MB, at most {most / 1e6:,.1f} MB")
    return read_member(archive, member)


def _tensor(storage: Any, offset: Any, shape: Any, strides: Any, *rest: Any) -> np.ndarray:
    """Return a tensor; raises ValueError if it is not made of numbers that are there, one after the other."""
    whole = isinstance(storage, _Storage) and isinstance(shape, tuple) and isinstance(strides, tuple)
    if not whole or len(shape) > MOST_AXES or len(strides) != len(shape):
        raise ValueError("a tensor without numbers, shape and strides")
    if not all(isinstance(each, int) and 0 <= each <= MOST_WEIGHTS for each in (offset, *shape, *strides)):
        raise ValueError("a tensor whose offset, shape or strides are no numbers of a tensor")
    packed = tuple(prod(shape[k + 1 :]) for k in range(len(shape)))
    size = prod(shape)
    if size > 1 and any(n > 1 and own != usual for n, own, usual in zip(shape, strides, packed, strict=True)):
        raise ValueError(f"a tensor with the strides {strides}")
    if offset + size > len(storage.numbers):
        raise ValueError(f"a tensor of {size} numbers, of which {max(len(storage.numbers) - offset, 0)} are there")
    return storage.numbers[offset : offset + size].reshape(shape)

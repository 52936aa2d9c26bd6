"""Changes of ``.npz`` files: arrays, their headers, and the zip around them."""

from __future__ import annotations

import io
import json
import pickle
import struct
import zipfile
from typing import Any

import numpy as np
from hypothesis import strategies as st
from odd import changed

TYPES = (
    "f4", "f2", ">f8", "i8", "i1", "u8", "?", "c16", "S8", "U8", "O", "M8[s]", "m8[ns]", "V8", "f8,i4", "g", "0U", "f8",
)  # fmt: skip
LIES = (
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (4000000000, 4000000000), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 1000000000000000000000), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (True,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': " + "(" * 300 + ", }",
    "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
    "{'descr': '<U1000000000', 'fortran_order': False, 'shape': (1,), }",
    "{'descr': '<f8', 'fortran_order': 7, 'shape': (), }",
    "{'descr': [('a', '<f8', (1000000000,))], 'fortran_order': False, 'shape': (1,), }",
    "__import__('os').abort()", "{}", "", "{" * 9000,
)  # fmt: skip
SENTINEL = "TOUCHED-BY-A-PICKLE"  # file in the working directory that a pickle of ours would leave


class Payload:
    """What leaves a file behind when it is unpickled."""

    def __reduce__(self) -> tuple[Any, tuple[str, str]]:
        return open, (SENTINEL, "w")


def unpack(content: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of a file, which may hold other members too."""
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return {name: array for name in arrays.files if isinstance(array := arrays[name], np.ndarray)}


def array_bytes(values: np.ndarray) -> bytes:
    """Return an array's file; objects are pickled."""
    stream = io.BytesIO()
    np.lib.format.write_array(stream, values, allow_pickle=True)
    return stream.getvalue()


def header_bytes(header: str, body: bytes = b"", version: int = 1) -> bytes:
    """Return an array's file with a header of one's own."""
    text = header.encode("latin1") + b"\n"
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<H" if version == 1 else "<I", len(text)) + text + body


def zipped(members: list[tuple[str, bytes]], compression: int = zipfile.ZIP_STORED) -> bytes:
    """Return a zip of members, whose names may occur twice."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(name), content, compression)
    return stream.getvalue()


def bomb(size: int) -> bytes:
    """Return an array's file of so many zero bytes."""
    header = f"{{'descr': '|u1', 'fortran_order': False, 'shape': ({size},), }}"
    return header_bytes(header, bytes(size))


@st.composite
def changed_array(draw: st.DrawFn, values: np.ndarray) -> tuple[bytes, str]:
    """Draw another array in the place of one; returns its file."""
    ways = ["type", "type", "shape", "shape", "lie", "value", "value", "value", "pickle", "order"]
    if values.dtype.kind == "U" and values.shape == ():
        ways += ["json"] * 12
    way = draw(st.sampled_from(ways))
    if way == "json":
        try:
            new, story = draw(changed(json.loads(str(values))))
            return array_bytes(np.array(json.dumps(new))), story
        except (ValueError, RecursionError):
            return array_bytes(np.array("[" * 50_000)), "brackets"
    if way == "type":
        name = draw(st.sampled_from(TYPES))
        try:
            with np.errstate(all="ignore"):
                return array_bytes(values.astype(np.dtype(name))), f"type {name}"
        except (TypeError, ValueError):
            return array_bytes(np.zeros(values.shape, name)), f"zeros of type {name}"
    if way == "shape":
        flat = np.ravel(values)
        size = draw(st.sampled_from([0, 1, 2, max(flat.size - 1, 0), flat.size + 1, 2 * flat.size]))
        forms = [np.resize(flat, size), flat, values.T, values[None], np.zeros((0, 5)), np.zeros((3, 0), values.dtype)]
        if values.ndim:
            forms += [values[:-1], values[1:], np.concatenate([values, values])]
        new_values = forms[draw(st.integers(0, len(forms) - 1))]
        return array_bytes(new_values), f"shape {values.shape} -> {new_values.shape}"
    if way == "lie":
        header, version = draw(st.sampled_from(LIES)), draw(st.sampled_from([1, 1, 2, 3]))
        return header_bytes(
            header, draw(st.sampled_from([b"", bytes(8), bytes(1000)])), version
        ), f"header {header[:70]}"
    if way == "pickle":
        payload = pickle.dumps(np.array([Payload()], dtype=object))
        return header_bytes("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", payload), "a pickle"
    if way == "order":
        return array_bytes(np.asfortranarray(values)), "Fortran order"
    return _other_values(draw, values)


def _other_values(draw: st.DrawFn, values: np.ndarray) -> tuple[bytes, str]:
    """Draw other numbers in some places of an array, or in all."""
    new = values.copy()
    if new.dtype.kind in "US":
        return array_bytes(np.full_like(new, "x")), "other texts"
    odd = draw(st.sampled_from([np.nan, np.inf, -np.inf, 1e308, -1e308, 1e30, 1e-320, 0.0, -1.0, 2.0**31, 7.0]))
    everywhere = draw(st.booleans())
    with np.errstate(all="ignore"):
        number = np.array(odd).astype(new.dtype)
        if everywhere or new.size == 0:
            new[...] = number
        else:
            new.flat[draw(st.integers(0, new.size - 1))] = number
    return array_bytes(new), f"{'all' if everywhere else 'one'} {odd}"


@st.composite
def changed_arrays(draw: st.DrawFn, content: bytes) -> tuple[bytes, str]:
    """Draw a change of an ``.npz`` file's arrays, their names, or of the zip."""
    try:
        arrays = unpack(content)
    except Exception:  # it is damaged already
        return content[: len(content) // 2], "cut in the middle"
    name = draw(st.sampled_from(sorted(arrays) or [""]))
    members = [(f"{each}.npy", array_bytes(values)) for each, values in arrays.items()]
    ways = ["array"] * 8 + ["gone", "more", "twice", "name", "swap", "bomb", "method", "tail", "lie", "text"]
    way = draw(st.sampled_from(ways)) if arrays else "more"
    compression, story = zipfile.ZIP_DEFLATED, way
    if way == "array":
        new, story = draw(changed_array(arrays[name]))
        members = [(each, new if each == f"{name}.npy" else old) for each, old in members]
    elif way == "gone":
        members = [(each, old) for each, old in members if each != f"{name}.npy"]
    elif way == "more":
        members.append((draw(st.sampled_from(["x.npy", "../../x.npy", "/etc/x.npy", "a/b", "", "a\x00b.npy"])), b"x"))
    elif way == "twice":
        members.append((f"{name}.npy", array_bytes(arrays[name])))
    elif way == "name":
        members = [(f"{each}x" if each == f"{name}.npy" else each, old) for each, old in members]
    elif way == "swap":
        other = draw(st.sampled_from(sorted(arrays)))
        swapped = {f"{name}.npy": f"{other}.npy", f"{other}.npy": f"{name}.npy"}
        members = [(swapped.get(each, each), old) for each, old in members]
        story = f"swapped with {other}"
    elif way == "bomb":
        members = [(each, bomb(2 * 10**8) if each == f"{name}.npy" else old) for each, old in members]
    elif way == "method":
        compression = draw(st.sampled_from([zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]))
    elif way == "text":
        members = [(each, b"" if each == f"{name}.npy" else old) for each, old in members]
    made = zipped(members, compression)
    if way == "tail":
        made = draw(st.sampled_from([made + b"more", b"more" + made, made + made, made[:-22]]))
    if way == "lie":  # of a size or another number in the zip's directory
        data, start = bytearray(made), made.rfind(b"PK\x01\x02")
        field = draw(st.integers(6, 42))
        data[start + field] ^= 1 << draw(st.integers(0, 7))
        made, story = bytes(data), f"directory's byte {field}"
    return made, f"{name}: {story}"

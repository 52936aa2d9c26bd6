"""Files of others are read within bounds, and whatever is wrong with them is told with the file's name."""

import io
import os
import struct
import time
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sffr_gym import ConfigError, load_params
from sffr_gym.config.reading import parse_json, read_arrays, read_bytes, read_csv, read_json, read_text
from sffr_gym.config.strict_yaml import MOST_YAML, find_config, read_mapping


def archive(file: Path, content: bytes, name: str = "a.npy", compression: int = zipfile.ZIP_DEFLATED) -> Path:
    """Write a zip of one member."""
    with zipfile.ZipFile(file, "w", compression) as target:
        target.writestr(name, content)
    return file


def array_bytes(header: str, body: bytes = b"") -> bytes:
    """Return an array's file with a header of one's own."""
    text = header.encode("latin1") + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + body


def test_arrays_come_back_as_they_were_saved(tmp_path: Path) -> None:
    """Of every kind of number, in both orders, and texts."""
    kept = {
        "a": np.arange(6.0).reshape(2, 3), "b": np.asfortranarray(np.arange(6).reshape(2, 3)), "c": np.array("text"),
        "d": np.zeros((0, 4)), "e": np.array([True, False]), "f": np.arange(3, dtype=">f4"),
    }  # fmt: skip
    np.savez_compressed(tmp_path / "file.npz", **kept)
    read = read_arrays(tmp_path / "file.npz")
    assert list(read) == list(kept)
    for name, values in kept.items():
        assert np.array_equal(read[name], values) and read[name].shape == values.shape


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(array_bytes("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000,), }"), id="lies"),
        pytest.param(array_bytes("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }"), id="negative"),
        pytest.param(array_bytes("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", b"\x80"), id="object"),
        pytest.param(array_bytes("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (0,), }"), id="fields"),
        pytest.param(array_bytes("{" * 500), id="nested"),
        pytest.param(array_bytes("x" * 9000), id="long"),
        pytest.param(array_bytes("{'descr': "), id="cut"),
        pytest.param(array_bytes("__import__('os')"), id="code"),
        pytest.param(b"\x93NUMPY\x07\x00", id="version"),
        pytest.param(b"", id="empty"),
    ],
)
def test_a_damaged_array_is_an_error_with_the_name_of_the_file(tmp_path: Path, content: bytes) -> None:
    """Nothing of it is allocated that its header announces, and nothing is run."""
    with pytest.raises(ConfigError, match=r"bad\.npz: is no \.npz file of plain arrays, or is damaged") as caught:
        read_arrays(archive(tmp_path / "bad.npz", content))
    assert str(caught.value).isprintable() and len(str(caught.value)) < 1000


def test_what_an_archive_announces_is_compared_before_it_is_expanded(tmp_path: Path) -> None:
    """A gigabyte of zeros is a megabyte in the file."""
    file = tmp_path / "bomb.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as target, target.open("a.npy", "w") as member:
        for _ in range(64):
            member.write(bytes(1 << 20))
    with pytest.raises(ConfigError, match=r"67\.1 MB once it is expanded, at most 32\.0 MB are read"):
        read_arrays(file, 32_000_000)


def test_an_archive_that_lies_about_a_size_expands_no_more_than_it_says(tmp_path: Path) -> None:
    """Its directory says 100 bytes where 64 MB follow."""
    file = archive(tmp_path / "lie.npz", bytes(64 << 20))
    content = bytearray(file.read_bytes())
    for mark, place in (b"PK\x01\x02", 24), (b"PK\x03\x04", 22):
        start = content.index(mark) + place
        content[start : start + 4] = struct.pack("<I", 100)
    file.write_bytes(content)
    tracemalloc.start()
    with pytest.raises(ConfigError, match="damaged"):
        read_arrays(file)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4 << 20


def test_a_compression_without_a_bound_is_not_expanded(tmp_path: Path) -> None:
    """Python's bzip2 and LZMA expand a whole member at once."""
    with pytest.raises(ConfigError, match="compressed by method 12"):
        read_arrays(archive(tmp_path / "b.npz", bytes(1000), compression=zipfile.ZIP_BZIP2))


def test_two_arrays_of_a_name_are_an_error(tmp_path: Path) -> None:
    """Which one would count?"""
    stream = io.BytesIO()
    np.save(stream, np.zeros(1))
    with zipfile.ZipFile(tmp_path / "two.npz", "w") as target, pytest.warns(UserWarning, match="Duplicate"):
        target.writestr("a.npy", stream.getvalue())
        target.writestr("a.npy", stream.getvalue())
    with pytest.raises(ConfigError, match="two arrays of the same name"):
        read_arrays(tmp_path / "two.npz")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1, "a": 2}', "key 'a' is given twice"),
        ('{"a": NaN}', "NaN is no number"),
        ("[" * 100_000, "nested too deeply"),
        ("", "is no valid JSON"),
        ("1" * 10_000, "is no valid JSON"),
    ],
)
def test_json_that_is_none_is_an_error(text: str, message: str) -> None:
    """Strictly what the standard says."""
    with pytest.raises(ConfigError, match=f"file: .*{message}"):
        parse_json(text, "file")


def test_what_is_no_file_is_an_error(tmp_path: Path) -> None:
    """A folder, a pipe that nobody writes to, a link to nowhere, a name that no file can have."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("nowhere")
    for name, message in (".", "Is a directory"), ("pipe", "not a regular file"), ("link", "No such file"):
        with pytest.raises(ConfigError, match=message):
            read_bytes(tmp_path / name, 10)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_bytes(Path("a\0b"), 10)
    with (tmp_path / "large").open("wb") as file:
        file.truncate(10**10)  # which takes no room
    with pytest.raises(ConfigError, match=r"is too large: 10,000\.0 MB, at most 1\.0 MB are read"):
        read_bytes(tmp_path / "large", 10**6)


def test_text_must_be_utf8(tmp_path: Path) -> None:
    """With a byte order mark or without."""
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfbase: 1")
    (tmp_path / "b").write_bytes(b"stra\xdfe")
    assert read_text(tmp_path / "a", 100) == "base: 1"
    with pytest.raises(ConfigError, match="is not text in UTF-8: byte 5 is 0xdf"):
        read_text(tmp_path / "b", 100)
    with pytest.raises(ConfigError, match="is not text in UTF-8"):
        read_json(tmp_path / "b")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1\n", r":2: must have 2 entries, has 1"),
        ("a,a,b\n1,2,3\n", "two columns of the same name"),
        ("a\n1\n", "has no column 'b'"),
        ("", "has no column 'a'"),
        ('a,b\n"1,2\n', "is no valid CSV"),
        ("a,b\n" + "1" * 200_000 + ",2\n", "is no valid CSV"),
    ],
)
def test_csv_that_is_none_is_an_error(tmp_path: Path, text: str, message: str) -> None:
    """Each row must have an entry for each column."""
    (tmp_path / "rows.csv").write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_csv(tmp_path / "rows.csv", ("a", "b"))


def aliases(depth: int, merged: bool = False) -> str:
    """Return references that stand for ten times as many values at each depth."""
    lines = ["x0: &x0 {a: 1}" if merged else "x0: &x0 [1]"]
    for k in range(1, depth):
        names = ", ".join(f"*x{k - 1}" for _ in range(10))
        lines.append(f"x{k}: &x{k} {{<<: [{names}]}}" if merged else f"x{k}: &x{k} [{names}]")
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param(aliases(9), "values once its references are written out", id="aliases"),
        pytest.param(aliases(9, merged=True), "values once its references are written out", id="merges"),
        pytest.param("a: &a [*a]", "refers to itself", id="circle"),
        pytest.param("[" * 50_000, "nested too deeply", id="deep"),
        pytest.param("? " * 40_000, "cannot be read as YAML|nested too deeply", id="keys"),
        pytest.param("a: !!int ''", "cannot be read as YAML", id="no number"),
        pytest.param("a: !!python/object/apply:os.system [true]", "cannot be read as YAML", id="code"),
        pytest.param("a: '" + "x" * MOST_YAML, "is too large: 0.1 MB, at most 0.1 MB are read", id="large"),
        pytest.param("a: 1\n" * 3, "key 'a' is given twice", id="twice"),
        pytest.param("\x00", "cannot be read as YAML", id="control"),
    ],
)
def test_yaml_that_would_never_end_is_an_error_at_once(tmp_path: Path, text: str, message: str) -> None:
    """Values are counted before any is made."""
    (tmp_path / "bomb.yaml").write_text(text)
    begun = time.perf_counter()
    with pytest.raises(ConfigError, match=message):
        read_mapping(tmp_path / "bomb.yaml")
    assert time.perf_counter() - begun < 5.0


def test_overrides_are_bounded_too() -> None:
    """They are the same language."""
    with pytest.raises(ConfigError, match="values once its references are written out"):
        load_params().with_overrides("panel.mounts={" + aliases(8).replace("\n", ", ") + "}")


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("lqr", "shipped"), ("./lqr", "own"), ("lqr.yaml", "own"), (Path("lqr"), "own"), ("practice/mixed", "shipped"),
        ("./practice/mixed", "own"),
    ],
)  # fmt: skip
def test_a_path_says_that_it_is_one(name: str, found: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever lies in the working directory, a bare name is the shipped one's."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "practice").mkdir()
    for own in "lqr", "lqr.yaml", "practice/mixed":
        (tmp_path / own).write_text("")
    folder = "scenarios" if "mixed" in str(name) else "policies"
    assert (find_config(name, folder).resolve().is_relative_to(tmp_path)) == (found == "own")


def test_a_bare_name_of_a_file_gets_a_hint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """That it is there, and how to name it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").write_text("")
    with pytest.raises(ConfigError, match=r"mine: no such file; for the file of that name write \./mine"):
        find_config("mine", "scenarios")


READERS: list[Callable[[Path], object]] = [read_json, read_arrays, lambda file: read_csv(file, ("a",)), read_mapping]


@pytest.mark.parametrize("reader", READERS)
def test_random_bytes_are_an_error(tmp_path: Path, reader: Callable[[Path], object]) -> None:
    """Of whatever kind, with the file's name."""
    rng = np.random.default_rng(0)
    for k in range(50):
        file = tmp_path / f"{k}.bin"
        file.write_bytes(rng.bytes(int(rng.integers(0, 300))))
        with pytest.raises(ConfigError, match=rf"{k}\.bin"):
            reader(file)


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("base: \x00", id="character"),
        pytest.param('"a\\nb": 1', id="key"),
        pytest.param('"a\\e[2J": 1', id="control"),
        pytest.param('"a\\nb": 1\n"a\\nb": 2', id="twice"),
        pytest.param("base: {mass: " + '"' + "x" * 50_000 + '"}', id="long"),
        pytest.param("? " + "x" * 900 + "\n: 1", id="long key"),
        pytest.param("base: !<tag:\u202e> 1", id="tag"),
        pytest.param('base: {mass: "\\ud800"}', id="half a surrogate pair"),
        pytest.param('"\\udfff": 1', id="key of half a surrogate pair"),
    ],
)
def test_what_a_message_shows_of_a_file_neither_breaks_the_line_nor_steers_the_terminal(
    tmp_path: Path, text: str
) -> None:
    """Keys and values are those of strangers."""
    (tmp_path / "odd.yaml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_params(tmp_path / "odd.yaml")
    for line in str(caught.value).splitlines():
        assert line.startswith(str(tmp_path / "odd.yaml"))
        assert line.isprintable() and len(line) < 1000


@pytest.mark.parametrize(
    "assignment",
    [
        "panel.EI=\n- 1",
        "a\nb=1",
        "base.mass=" + "[" * 5000,
        "arms.\x1b.mass=1",
        "base.mass.a\nb=1",
        "a" * 9999,
        "arms." + "9" * 9999 + ".mass=1",
    ],
)
def test_an_override_is_shown_in_a_line(assignment: str) -> None:
    """However long, and whatever is in it."""
    with pytest.raises(ConfigError) as caught:
        load_params().with_overrides(assignment)
    for line in str(caught.value).splitlines():
        assert line.startswith("override '") and line.isprintable() and len(line) < 1000


def test_what_was_read_is_the_readers_own(tmp_path):
    """The same text is parsed once, and what somebody does to its values reaches nobody else."""
    file = tmp_path / "a.yaml"
    file.write_text("a: {b: [1, 2]}\n", encoding="utf-8")
    first, _ = read_mapping(file)
    first["a"]["b"].append(3)
    first["a"]["c"] = 4
    assert read_mapping(file)[0] == {"a": {"b": [1, 2]}}

"""The cache of compiled code, by a package with two small kernels: what is read, refused, and compiled again."""

import errno
import importlib
import logging
import os
import pickle
import shutil
import sys

import numba
import pytest
import small_package
from numba.core.serialize import dumps

from sffr_gym.compile import cache, folders
from sffr_gym.compile.cache import KernelCache

POSIX = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="owners and modes of files")


@pytest.fixture
def package(tmp_path):
    return small_package.write(tmp_path)


@pytest.fixture
def start(package, monkeypatch):
    """A function that imports the package as a new process would, and returns its ``loop``."""
    monkeypatch.syspath_prepend(package)
    monkeypatch.setattr(folders, "ROOTS", [package / "cache"])
    monkeypatch.setattr(folders, "_told", [])
    monkeypatch.setattr(KernelCache, "cleaned", True)

    def imported():
        monkeypatch.setattr(cache, "_sources", [])
        monkeypatch.setattr(cache, "_folders", {})
        for name in [name for name in sys.modules if name.partition(".")[0] == "law"]:
            del sys.modules[name]
        importlib.invalidate_caches()
        return importlib.import_module("law.loop").loop

    yield imported
    for name in [name for name in sys.modules if name.partition(".")[0] == "law"]:
        del sys.modules[name]


def compiled(loop):
    """How many signatures of a kernel came from the compiler, and how many from the cache."""
    return sum(loop.stats.cache_misses.values()), sum(loop.stats.cache_hits.values())


def entries(package):
    return sorted((package / "cache").rglob("*" + folders.CODE))


def test_what_is_compiled_once_is_read_ever_after(start, package):
    first = start()
    assert not cache.is_compiled()
    assert first(1.0) == 3.0 and first(1) == 3 and compiled(first) == (2, 0)
    assert cache.is_compiled()
    assert len(entries(package)) == 4, "a file for each signature of each kernel"
    second = start()
    assert second(1.0) == 3.0 and second(1) == 3 and compiled(second) == (0, 2)


def other_numba(file):
    """numba's own index, of another version."""
    return pickle.dumps("0.1") + pickle.dumps(("stamp", {}))


DAMAGE = {
    "empty": lambda file: b"",
    "cut": lambda file: file.read_bytes()[: len(file.read_bytes()) // 2],
    "garbage": lambda file: bytes(range(256)) * 8,
    "zeros in the middle": lambda file: file.read_bytes()[:500] + bytes(2000) + file.read_bytes()[2500:],
    "index of another numba": other_numba,
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_file_is_compiled_and_written_again(start, package, damage):
    assert start()(1.0) == 3.0
    for file in entries(package):
        file.write_bytes(DAMAGE[damage](file))
    again = start()
    assert again(1.0) == 3.0 and compiled(again) == (1, 0)
    mended = start()
    assert mended(1.0) == 3.0 and compiled(mended) == (0, 1)


@pytest.mark.parametrize(
    "content", [b"", b"\x80\x05.", dumps(None), dumps((("another", "key"), ())), dumps((1, 2, 3))], ids=repr
)
def test_a_whole_file_of_something_else_is_compiled_again(start, package, content):
    assert start()(1.0) == 3.0
    for file in entries(package):
        folders.write_sealed(file, content)
    again = start()
    assert again(1.0) == 3.0 and compiled(again) == (1, 0)


def test_code_of_another_signature_is_not_run(start, package):
    """Whatever name its file has."""
    loop = start()
    assert loop(1.0) == 3.0 and loop(1) == 3
    one, other = (file for file in entries(package) if file.name.startswith("loop."))
    contents = one.read_bytes(), other.read_bytes()
    other.write_bytes(contents[0]), one.write_bytes(contents[1])
    again = start()
    assert again(1.5) == 4.0 and again(1) == 3 and compiled(again) == (2, 0)


def test_code_that_cannot_be_loaded_is_compiled_again(start, package):
    """Of the right key, as by another numba of the same version number."""
    assert start()(1.0) == 3.0
    for file in entries(package):
        key, parts = pickle.loads(folders.read_sealed(file))
        folders.write_sealed(file, dumps((key, ("nonsense", *parts[1:]))))
    again = start()
    assert again(1.0) == 3.0 and compiled(again) == (1, 0)


def in_place_of_files(package):
    for file in entries(package):
        file.unlink()
        file.symlink_to(package / "missing")


def folders_in_place_of_files(package):
    for file in entries(package):
        file.unlink()
        file.mkdir()


def no_folder_any_more(package):
    shutil.rmtree(package / "cache")


@pytest.mark.parametrize("replace", [in_place_of_files, folders_in_place_of_files, no_folder_any_more])
def test_what_vanished_after_the_start_is_compiled(start, package, replace):
    assert start()(1.0) == 3.0
    loop = start()
    replace(package)
    assert cache.is_compiled() == (replace is not no_folder_any_more)
    assert loop(1.0) == 3.0 and compiled(loop) == (1, 0)


class Attack:
    """Makes a folder when it is unpickled."""

    def __init__(self, folder):
        self.folder = folder

    def __reduce__(self):
        return os.mkdir, (str(self.folder),)


def plant(package, seal=True):
    """Put a pickle that runs code into the place of what was compiled; return what shows that it did."""
    trace = package / "attacked"
    for file in entries(package):
        content = pickle.dumps(Attack(trace))
        if seal:
            folders.write_sealed(file, content)
        else:
            file.write_bytes(content)
    return trace


def test_a_planted_pickle_would_run(start, package):
    """Else the next tests show nothing."""
    start()(1.0)
    trace = plant(package)
    assert start()(1.0) == 3.0 and trace.is_dir()


@POSIX
@pytest.mark.parametrize("what", ["root", "folder", "file"])
def test_code_that_others_can_write_is_not_run(start, package, what, caplog):
    start()(1.0)
    trace = plant(package)
    file = entries(package)[0]
    for each in {"root": [package / "cache"], "folder": [file.parent], "file": entries(package)}[what]:
        each.chmod(each.stat().st_mode | 0o002)
    with caplog.at_level(logging.WARNING):
        again = start()
        assert again(1.0) == 3.0
    assert not trace.exists()
    assert len(caplog.messages) == (0 if what == "file" else 1)


@POSIX
def test_folders_that_are_swapped_after_the_start_are_not_read(start, package, monkeypatch):
    """The owner of what is read counts, not that of what lay there before."""
    start()(1.0)
    loop = start()
    trace = plant(package)
    for file in entries(package):
        file.chmod(0o666)
    assert loop(1.0) == 3.0 and not trace.exists()


def test_a_pickle_without_a_seal_is_not_run(start, package):
    start()(1.0)
    trace = plant(package, seal=False)
    assert start()(1.0) == 3.0 and not trace.exists()


def test_a_full_disk_stops_nobody(start, package, monkeypatch, caplog):
    """What cannot be kept is said once, and leaves nothing behind."""

    def full(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with caplog.at_level(logging.WARNING):
        loop = start()
        assert loop(1.0) == 3.0 and loop(1) == 3
    (message,) = caplog.messages
    assert "No space left on device" in message and "NUMBA_CACHE_DIR" in message and "\n" not in message
    assert {path.name for path in (package / "cache").rglob("*") if path.is_file()} == {folders.MARK}


def test_without_a_place_kernels_compile(start, monkeypatch):
    monkeypatch.setattr(folders, "ROOTS", [])
    for _ in range(2):
        loop = start()
        assert loop(1.0) == 3.0 and compiled(loop)[1] == 0
        assert not cache.is_compiled()


def test_kernels_of_modules_that_nobody_hashed_are_not_kept(start, package):
    """An edit of what they call would go unnoticed."""
    file = package / "own.py"
    file.write_text(small_package.FILES["loop.py"])
    start()(1.0)
    before = entries(package)
    loop = importlib.import_module("own").loop
    assert loop(1.0) == 3.0
    assert entries(package) == before and loop.stats.cache_path is None
    del sys.modules["own"]


def test_compiling_removes_what_nobody_uses(start, package, monkeypatch):
    start()
    old = package / "cache" / "0123456789abcdef"
    folders._make_marked(old)
    os.utime(old, (0, 0))
    monkeypatch.setattr(KernelCache, "cleaned", False)
    loop = start()
    assert old.is_dir(), "starting removes nothing"
    loop(1.0)
    assert not old.exists() and entries(package)


def test_an_edit_of_what_a_kernel_calls_is_seen(start, package):
    """numba's own cache would not see it."""
    assert start()(1.0) == 3.0
    (package / "law" / "gain.py").write_text(small_package.FILES["gain.py"].replace("2 * x", "5 * x"))
    assert start()(1.0) == 6.0


@pytest.mark.parametrize("setting", ["compiler", "processor"])
def test_code_of_another_compiler_or_processor_is_not_ours(start, setting, monkeypatch):
    start()(1.0)
    if setting == "compiler":
        monkeypatch.setattr(cache, "COMPILERS", (*cache.COMPILERS, "another"))
    else:
        monkeypatch.setattr(numba.config, "CPU_NAME", "generic")
    start()
    assert not cache.is_compiled()

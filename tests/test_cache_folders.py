"""Where compiled code is kept: whose folders are used, what is done where none can be, and what is ever removed."""

import errno
import logging
import os
import tempfile
import time
from pathlib import Path

import pytest

from sffr_gym.compile import folders

NAME = "0123456789abcdef"
POSIX = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="owners and modes of files")


def no_home():
    raise RuntimeError("Could not determine home directory.")


@pytest.fixture
def roots(tmp_path, monkeypatch):
    """Two places that do not exist yet."""
    monkeypatch.setattr(folders, "ROOTS", [tmp_path / "first", tmp_path / "second"])
    monkeypatch.setattr(folders, "_told", [])
    return folders.ROOTS


def give_away(path, monkeypatch):
    """Let a file or folder be another user's."""
    if os.geteuid() == 0:
        os.chown(path, 1, -1, follow_symlinks=False)
    else:
        owner = os.geteuid()
        monkeypatch.setattr(os, "geteuid", lambda: owner + 1)


@pytest.mark.parametrize(
    ("variables", "chosen"),
    [
        ({}, "home/.cache"),
        ({"XDG_CACHE_HOME": "/xdg"}, "/xdg"),
        ({"XDG_CACHE_HOME": ""}, "home/.cache"),
        ({"XDG_CACHE_HOME": "relative"}, "home/.cache"),
        ({"NUMBA_CACHE_DIR": "/numba", "XDG_CACHE_HOME": "/xdg"}, "/numba"),
        ({"NUMBA_CACHE_DIR": "", "XDG_CACHE_HOME": "/xdg"}, "/xdg"),
        ({"NUMBA_CACHE_DIR": "numba"}, "work/numba"),
        ({"HOME": ""}, None),
        ({"HOME": "relative"}, None),
    ],
)
def test_empty_variables_count_as_unset_and_every_place_is_absolute(tmp_path, monkeypatch, variables, chosen):
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    for name, value in (
        {"HOME": str(tmp_path / "home"), "NUMBA_CACHE_DIR": "", "XDG_CACHE_HOME": ""} | variables
    ).items():
        monkeypatch.setenv(name, value)
    *first, last = folders.cache_roots()
    assert first == ([tmp_path / chosen / "sffr-gym"] if chosen else [])
    assert last.parent == Path(tempfile.gettempdir()) and last.name.startswith("sffr-gym")
    assert all(root.is_absolute() for root in (*first, last))


def test_home_is_asked_for_only_where_it_is_needed(monkeypatch):
    """A container's user has none."""
    monkeypatch.setattr(Path, "home", no_home)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/numba")
    assert folders.cache_roots()[0] == Path("/numba/sffr-gym")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert [root.parent for root in folders.cache_roots()] == [Path(tempfile.gettempdir())]


def test_a_working_folder_that_is_gone_names_no_place(tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    monkeypatch.setenv("NUMBA_CACHE_DIR", "relative")
    monkeypatch.setattr(tempfile, "gettempdir", lambda: os.getcwd())
    assert folders.cache_roots() == []


@POSIX
def test_folders_are_private_and_marked(roots):
    folder = folders.open_folder(NAME)
    assert folder == roots[0] / NAME
    assert {path.stat().st_mode & 0o777 for path in (folder, folder.parent)} == {0o700}
    assert (folder / folders.MARK).read_bytes().startswith(b"Signature: 8a477f597d28d172789f06886806bc55\n")
    os.utime(folder, (0, 0))
    assert folders.open_folder(NAME) == folder
    assert time.time() - folder.stat().st_mtime < 60, "in use"


@POSIX
def test_a_folder_that_was_there_gets_no_mark(roots):
    (roots[0] / NAME).mkdir(parents=True, mode=0o700)
    assert folders.open_folder(NAME) == roots[0] / NAME
    assert list((roots[0] / NAME).iterdir()) == []


def make(root):
    """A root with an empty folder."""
    (root / NAME).mkdir(parents=True, mode=0o700)
    return root / NAME


def root_is_a_file(root, monkeypatch):
    root.touch()
    return root, "this is no folder"


def root_below_a_file(root, monkeypatch):
    root.touch()
    monkeypatch.setattr(folders, "ROOTS", [root / "below", *folders.ROOTS[1:]])
    return root / "below", "Not a directory"


def root_below_a_dangling_link(root, monkeypatch):
    root.symlink_to(root.parent / "missing")
    monkeypatch.setattr(folders, "ROOTS", [root / "below", *folders.ROOTS[1:]])
    return root, "this is no folder"


def root_dangles(root, monkeypatch):
    root.symlink_to(root.parent / "missing")
    return root, "this is no folder"


def root_open_to_others(root, monkeypatch):
    make(root)
    root.chmod(0o777)
    return root, f"chmod go-w {root}"


def folder_open_to_a_group(root, monkeypatch):
    make(root).chmod(0o770)
    return root / NAME, f"chmod go-w {root / NAME}"


def folder_is_a_file(root, monkeypatch):
    make(root).rmdir()
    (root / NAME).touch()
    return root / NAME, "this is no folder"


def folder_dangles(root, monkeypatch):
    make(root).rmdir()
    (root / NAME).symlink_to(root / "missing")
    return root / NAME, "this is no folder"


def folder_cannot_be_made(root, monkeypatch):
    mkdir = Path.mkdir

    def refuse(path, *arguments, **named):
        if path == root / NAME:
            raise OSError(errno.EROFS, "Read-only file system", str(path))
        mkdir(path, *arguments, **named)

    monkeypatch.setattr(Path, "mkdir", refuse)
    return root / NAME, "Read-only"


def _deny(folder, denied, monkeypatch):
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: access(path, mode) and not (path == folder and mode & denied))
    return folder, "you may not"


def folder_cannot_be_read(root, monkeypatch):
    return _deny(make(root), os.R_OK, monkeypatch)


def empty_folder_cannot_be_written(root, monkeypatch):
    return _deny(make(root), os.W_OK, monkeypatch)


def told(caplog, path, reason):
    """The one line that was logged, after a look at what it says."""
    (message,) = caplog.messages
    assert "\n" not in message and "NUMBA_CACHE_DIR" in message
    assert f"{path}: " in message and reason in message
    return message


@POSIX
@pytest.mark.parametrize(
    "spoil",
    [
        root_is_a_file, root_below_a_file, root_dangles, root_below_a_dangling_link, root_open_to_others,
        folder_open_to_a_group, folder_is_a_file, folder_dangles, folder_cannot_be_made, folder_cannot_be_read,
        empty_folder_cannot_be_written,
    ],
)  # fmt: skip
def test_a_place_that_cannot_be_used_is_named_once_and_another_taken(spoil, roots, monkeypatch, caplog):
    path, reason = spoil(roots[0], monkeypatch)
    with caplog.at_level(logging.WARNING):
        assert folders.open_folder(NAME) == roots[1] / NAME
        folders.open_folder(NAME[::-1])
    assert f"kept in {roots[1]} instead" in told(caplog, path, reason)


def root_of_others(root):
    make(root)
    return root


def link_to_a_folder(root):
    (root.parent / "target").mkdir(mode=0o700)
    make(root).rmdir()
    (root / NAME).symlink_to(root.parent / "target")
    return root / NAME


@POSIX
@pytest.mark.parametrize("prepare", [root_of_others, make, link_to_a_folder])
def test_a_place_of_others_is_not_used(prepare, roots, monkeypatch, caplog):
    path = prepare(roots[0])
    give_away(path, monkeypatch)
    monkeypatch.setattr(folders, "ROOTS", roots[:1])
    with caplog.at_level(logging.WARNING):
        assert folders.open_folder(NAME) is None
    told(caplog, path if os.getuid() == 0 else roots[0], "another user")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can make root's folders")
def test_what_the_administrator_made_is_used(roots, monkeypatch):
    """As the compiled code of an image."""
    folder = folders.open_folder(NAME)
    folders.write_sealed(folder / "kernel", b"code")
    monkeypatch.setattr(os, "geteuid", lambda: 1)
    assert folders.open_folder(NAME) == folder
    assert folders.read_sealed(folder / "kernel") == b"code"


@POSIX
def test_without_any_place_nothing_is_kept(roots, monkeypatch, caplog):
    for root in roots:
        root.touch()
    with caplog.at_level(logging.WARNING):
        assert folders.open_folder(NAME) is None
    (message,) = caplog.messages
    assert "not kept" in message
    monkeypatch.setattr(folders, "ROOTS", [])
    assert folders.open_folder(NAME) is None


@POSIX
def test_a_link_to_a_folder_of_ones_own_is_followed(roots, tmp_path):
    (tmp_path / "large disk").mkdir(mode=0o700)
    roots[0].symlink_to(tmp_path / "large disk")
    assert folders.open_folder(NAME) == roots[0] / NAME
    assert (tmp_path / "large disk" / NAME).is_dir()


def test_a_read_only_folder_with_compiled_code_is_used(roots, monkeypatch, caplog):
    """As in an image: it can be neither touched nor written."""
    folder = folders.open_folder(NAME)
    folders.write_sealed(folder / f"kernel{folders.CODE}", b"code")

    def refuse(path, *arguments, **named):
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    monkeypatch.setattr(os, "utime", refuse)
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    with caplog.at_level(logging.WARNING):
        assert folders.open_folder(NAME) == folder
    assert caplog.messages == []


def test_workers_say_nothing(roots, monkeypatch, caplog):
    roots[0].touch()
    monkeypatch.setattr(folders.multiprocessing, "parent_process", lambda: object())
    with caplog.at_level(logging.WARNING):
        assert folders.open_folder(NAME) == roots[1] / NAME
    assert caplog.messages == []


def test_any_damage_of_a_file_is_found(tmp_path):
    file, content = tmp_path / "kernel", b"compiled code"
    folders.write_sealed(file, content)
    assert folders.read_sealed(file) == content
    whole = file.read_bytes()
    for size in range(len(whole)):
        file.write_bytes(whole[:size])
        assert folders.read_sealed(file) is None
        file.write_bytes(whole[:size] + bytes([whole[size] ^ 1]) + whole[size + 1 :])
        assert folders.read_sealed(file) is None
    file.write_bytes(whole + b"\0")
    assert folders.read_sealed(file) is None


@POSIX
def test_files_that_others_can_write_are_not_read(tmp_path, monkeypatch):
    file, mask = tmp_path / "kernel", os.umask(0)
    try:
        folders.write_sealed(file, b"code")
    finally:
        os.umask(mask)
    assert folders.read_sealed(file) == b"code", "whatever the mask of the user is"
    file.chmod(0o620)
    with pytest.raises(PermissionError, match="others may write"):
        folders.read_sealed(file)
    file.chmod(0o600)
    give_away(file, monkeypatch)
    with pytest.raises(PermissionError, match="another user"):
        folders.read_sealed(file)


def test_a_write_that_fails_leaves_the_file_and_nothing_else(tmp_path, monkeypatch):
    folder = tmp_path / NAME
    folders.write_sealed(folder / "kernel", b"old")

    def full(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space"):
        folders.write_sealed(folder / "kernel", b"new")
    assert folders.read_sealed(folder / "kernel") == b"old"
    assert sorted(path.name for path in folder.iterdir()) == [folders.MARK, "kernel"], "made, and marked"

"""Folders of compiled code: where they lie, whom they may belong to, and when they are removed.

Compiled code is run as it is found. It is taken only from folders and files that nobody but this user and the
administrator can have written; a folder of anybody else's is as good as none. Nothing is removed but files that this
module wrote, in folders that carry its name and its mark.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import logging
import multiprocessing
import os
import re
import stat
import tempfile
import time
from collections.abc import Collection
from pathlib import Path

CODE, PART = ".nbi", ".part"  # endings of compiled code, and of what is being written
MAX_AGE = 30 * 24 * 3600.0  # s, folders that nobody used for so long are removed
NAME = re.compile(r"[0-9a-f]{16}")  # of a folder: a hash of sources
MARK = "CACHEDIR.TAG"  # by which backups know what they may leave out, https://bford.info/cachedir
MARK_TEXT = b"""Signature: 8a477f597d28d172789f06886806bc55
# Code that sffr-gym compiled. It made this folder, and removes it when nobody has used it for a month.
"""
NOT_KEPT = "is not kept, and every start compiles again"
DIGEST_SIZE = hashlib.sha256().digest_size

_told: list[str] = []  # what this process has said


def cache_roots() -> list[Path]:
    """Return where folders of compiled code may lie, the user's choice first: absolute, whether they exist or not.

    ``NUMBA_CACHE_DIR``, else ``XDG_CACHE_HOME``, else ``.cache`` at home; in each of them ``sffr-gym``. Where that is
    of no use, a folder of this user's in the system's temporary one. A variable that is empty counts as unset, and so
    does a relative ``XDG_CACHE_HOME``, as the XDG specification says.
    """
    roots = []
    with contextlib.suppress(OSError, RuntimeError):  # a working folder that is gone; nobody's home
        roots.append(_chosen_root() / "sffr-gym")
    with contextlib.suppress(OSError):  # no temporary folder either
        user = f"-{os.geteuid()}" if hasattr(os, "geteuid") else ""
        roots.append(Path(tempfile.gettempdir()).absolute() / f"sffr-gym{user}")
    return roots


def _chosen_root() -> Path:
    """The folder that holds ours, as environment variables and home say.

    Raises:
        OSError: if it is relative to a working folder that is gone.
        RuntimeError: if there is no home.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen).absolute()  # numba itself would follow every change of the working folder
    chosen = os.environ.get("XDG_CACHE_HOME", "")
    if Path(chosen).is_absolute():
        return Path(chosen)
    home = Path.home()
    if os.environ.get("HOME") == "" or not home.is_absolute():
        raise RuntimeError("no home")
    return home / ".cache"


ROOTS = cache_roots()


def open_folder(name: str) -> Path | None:
    """Return the folder of compiled code of this name, made if need be and marked as in use.

    Args:
        name: 16 hexadecimal digits.

    Returns:
        The first that may be used; None if there is none. What speaks against the first place is told once.
    """
    why = None
    for root in ROOTS:
        try:
            folder = _open(root, name)
        except OSError as error:
            why = why or error
            continue
        if why is not None:
            tell(why.filename, why, f"is kept in {root} instead")
        return folder
    if why is not None:
        tell(why.filename, why, NOT_KEPT)
    return None


def tell(where: str | Path, error: OSError, outcome: str) -> None:
    """Log once in a process what is wrong with a folder of compiled code and what comes of it; not in workers.

    No warning: nobody's code can be changed to do without it, and ``-W error`` must not keep anybody from importing.
    """
    if not _told and multiprocessing.parent_process() is None:
        advice = "NUMBA_CACHE_DIR can name another folder"
        _told.append(f"sffr-gym: {where}: {error.strerror or error}; compiled code {outcome}. {advice}.")
        logging.getLogger("sffr_gym").warning("%s", _told[0])


def _open(root: Path, name: str) -> Path:
    """Return a folder of compiled code below a root, made if need be and marked as in use.

    Raises:
        OSError: if it cannot be made, or must not or cannot be used.
    """
    folder = root / name
    _make(root)
    check_owner(root, root.lstat(), root.stat())
    _make_marked(folder)
    check_owner(folder, folder.lstat(), folder.stat())
    if not os.access(folder, os.R_OK | os.X_OK):
        raise PermissionError(errno.EACCES, "you may not read it", str(folder))
    if not os.access(folder, os.W_OK) and not holds_code(folder):
        raise PermissionError(errno.EACCES, "you may not write there", str(folder))
    with contextlib.suppress(OSError):  # it may be read only, as in an image
        os.utime(folder)
    return folder


def _make(folder: Path) -> None:
    """Make a folder that nobody else may enter, unless there is one.

    Raises:
        OSError: if that is impossible.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except FileExistsError as error:
        raise NotADirectoryError(errno.ENOTDIR, "this is no folder", error.filename) from None


def _make_marked(folder: Path) -> None:
    """Make a folder of compiled code with our mark, unless there is one; a folder that we found gets none.

    Raises:
        OSError: if that is impossible.
    """
    new = not folder.exists()
    _make(folder)
    if new:
        (folder / MARK).write_bytes(MARK_TEXT)


def check_owner(path: Path, *found: os.stat_result) -> None:
    """Make sure that nobody but this user and the administrator can have written a file or folder.

    Windows has other means for that, and keeps these folders private.

    Args:
        path: of it.
        found: what the system says of it, and of the link that leads there.

    Raises:
        PermissionError: if others can.
    """
    if not hasattr(os, "geteuid"):
        return
    if any(each.st_uid not in (0, os.geteuid()) for each in found):
        raise PermissionError(errno.EPERM, "it belongs to another user", str(path))
    if any(each.st_mode & 0o022 and not stat.S_ISLNK(each.st_mode) for each in found):
        raise PermissionError(errno.EPERM, f"others may write there (chmod go-w {path})", str(path))


def read_sealed(file: Path) -> bytes | None:
    """Return what :func:`write_sealed` wrote to a file; None if it is damaged.

    Raises:
        OSError: if it cannot be read, or others can have written it.
    """
    with file.open("rb") as opened:
        check_owner(file, os.fstat(opened.fileno()))  # of what is read, whatever happens to its name meanwhile
        content = opened.read()
    digest, content = content[:DIGEST_SIZE], content[DIGEST_SIZE:]
    return content if digest == hashlib.sha256(content).digest() else None


def write_sealed(file: Path, content: bytes) -> None:
    """Write a file behind a digest of what it holds, whole or not at all, by which damage is found.

    Whoever else writes the same file at the same time, in this or in another machine, does not matter. The folder is
    made if it has been removed.

    Raises:
        OSError: if that is impossible; nothing is left then.
    """
    _make_marked(file.parent)
    handle, part = tempfile.mkstemp(dir=file.parent, prefix=".", suffix=PART)  # which nobody else may write
    try:
        with open(handle, "wb") as opened:
            opened.write(hashlib.sha256(content).digest() + content)
        os.replace(part, file)
    except BaseException:
        Path(part).unlink(missing_ok=True)
        raise


def holds_code(folder: Path) -> bool:
    """Say whether compiled code lies in a folder."""
    return any(each.suffix == CODE for each in _entries(folder))


def remove_stale(in_use: Collection[Path]) -> None:
    """Remove folders of compiled code that nobody used for a month.

    Args:
        in_use: those of this process.
    """
    for root in ROOTS:
        with contextlib.suppress(OSError):
            check_owner(root, root.stat())
            for folder in _entries(root):
                with contextlib.suppress(OSError):  # such as another process that is faster
                    if folder not in in_use and _is_ours(folder) and time.time() - folder.lstat().st_mtime > MAX_AGE:
                        _remove(folder)


def _is_ours(folder: Path) -> bool:
    """Whether this module can prove that it made a folder for this user: by its name, its owner and its mark."""
    found, mark = folder.lstat(), folder / MARK
    return (
        NAME.fullmatch(folder.name) is not None
        and stat.S_ISDIR(found.st_mode)  # not what a link leads to
        and found.st_uid == (os.geteuid() if hasattr(os, "geteuid") else found.st_uid)
        and stat.S_ISREG(mark.lstat().st_mode)
        and mark.read_bytes() == MARK_TEXT
    )


def _remove(folder: Path) -> None:
    """Remove compiled code, and the folder if nothing else is in it.

    Raises:
        OSError: if some of it cannot be removed.
    """
    for file in _entries(folder):
        if file.suffix in (CODE, PART):
            file.unlink()
    if [each.name for each in _entries(folder)] == [MARK]:
        (folder / MARK).unlink()
        folder.rmdir()


def _entries(folder: Path) -> list[Path]:
    """What lies in a folder; nothing if there is none or it may not be read."""
    try:
        return list(folder.iterdir())
    except OSError:
        return []

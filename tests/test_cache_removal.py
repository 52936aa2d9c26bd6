"""What is removed from the cache: compiled code of our own that nobody used for a month, and nothing else at all."""

import os
import shutil
import subprocess
import sys
import time

import pytest

from sffr_gym.compile import folders

NAME = "0123456789abcdef"
MONTHS = 60 * 24 * 3600.0  # s


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "ROOTS", [tmp_path / "root", tmp_path / "missing"])
    return tmp_path / "root"


def make_old(folder, age=MONTHS):
    then = time.time() - age
    os.utime(folder, (then, then))


def cache(root, name=NAME, age=MONTHS):
    """A folder of compiled code of an age in seconds."""
    folder = root / name
    folders._make_marked(folder)
    folders.write_sealed(folder / f"kernel.1{folders.CODE}", b"code")
    (folder / f".killed{folders.PART}").touch()
    make_old(folder, age)
    return folder


def tree(root):
    return {path.relative_to(root).as_posix() for path in root.rglob("*")}


def test_what_nobody_used_for_a_month_goes(root):
    cache(root)
    cache(root, "f" * 16, age=29 * 24 * 3600.0)
    in_use = cache(root, "a" * 16)
    folders.remove_stale({in_use})
    assert {path.name for path in root.iterdir()} == {"f" * 16, "a" * 16}
    assert len(tree(in_use)) == 3


def mark_missing(root):
    (cache(root) / folders.MARK).unlink()


def mark_of_another_program(root):
    (cache(root) / folders.MARK).write_text("Signature: 8a477f597d28d172789f06886806bc55\n# of cargo\n")


def mark_is_a_link(root):
    folder = cache(root)
    (folder / folders.MARK).rename(root / "mark")
    (folder / folders.MARK).symlink_to(root / "mark")


def mark_is_a_folder(root):
    mark_missing(root)
    (root / NAME / folders.MARK).mkdir()


def folder_is_a_link(root):
    folder = cache(root)
    folder.rename(root.parent / "elsewhere")
    folder.symlink_to(root.parent / "elsewhere")
    os.utime(folder, (0, 0), follow_symlinks=False)


def dangling_link(root):
    root.mkdir()
    (root / NAME).symlink_to(root / "nowhere")


def file_in_place_of_a_folder(root):
    root.mkdir()
    (root / NAME).touch()
    make_old(root / NAME)


def made_in_the_future(root):
    cache(root, age=-MONTHS)


def root_open_to_others(root):
    cache(root)
    root.chmod(0o777)


def names_of_others(root):
    for name in ("my-results", NAME[:-1], NAME + "0", NAME.upper(), "0123456789abcdeg", f"{NAME}\n"):
        cache(root, name)


@pytest.mark.parametrize(
    "make",
    [
        mark_missing, mark_of_another_program, mark_is_a_link, mark_is_a_folder, folder_is_a_link, dangling_link,
        file_in_place_of_a_folder, made_in_the_future, root_open_to_others, names_of_others,
    ],
)  # fmt: skip
def test_what_cannot_be_proved_to_be_ours_stays(root, make):
    make(root)
    for folder in root.iterdir():
        if folder.is_dir() and not folder.is_symlink() and make is not made_in_the_future:
            make_old(folder)
    before = tree(root.parent)
    folders.remove_stale(set())
    assert tree(root.parent) == before and before


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give files away")
def test_folders_of_other_users_stay(root):
    folder = cache(root)
    os.chown(folder, 1, -1)
    make_old(folder)
    before = tree(root)
    folders.remove_stale(set())
    assert tree(root) == before


def test_what_others_put_there_stays(root):
    """With the mark: the folder is still ours."""
    folder = cache(root)
    (folder / "thesis.csv").write_text("1,2\n")
    (folder / "data").mkdir()
    (folder / "data" / f"raw{folders.CODE}").touch()
    make_old(folder)
    folders.remove_stale(set())
    assert tree(folder) == {folders.MARK, "thesis.csv", "data", f"data/raw{folders.CODE}"}


def test_what_a_link_leads_to_stays(root, tmp_path):
    folder = cache(root)
    (tmp_path / f"mine{folders.CODE}").write_text("mine")
    (tmp_path / f"folder{folders.CODE}").mkdir()
    for name in ("mine", "folder"):
        (folder / f"{name}{folders.CODE}").symlink_to(tmp_path / f"{name}{folders.CODE}")
    make_old(folder)
    folders.remove_stale(set())
    assert not folder.exists()
    assert (tmp_path / f"mine{folders.CODE}").read_text() == "mine" and (tmp_path / f"folder{folders.CODE}").is_dir()


def test_a_folder_that_another_process_removes_meanwhile_does_not_matter(root, monkeypatch):
    first, second = cache(root, "a" * 16), cache(root, "b" * 16)
    is_ours = folders._is_ours

    def and_gone(folder):
        known = is_ours(folder)
        shutil.rmtree(first, ignore_errors=True)
        return known

    monkeypatch.setattr(folders, "_is_ours", and_gone)
    folders.remove_stale(set())
    assert not first.exists() and not second.exists()


def test_code_that_may_not_be_removed_stays_without_an_error(root, monkeypatch):
    folder = cache(root)

    def refuse(path, *arguments, **named):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(type(root), "unlink", refuse)
    before = tree(folder)
    folders.remove_stale(set())
    assert tree(folder) == before


def test_an_empty_variable_costs_nobody_a_folder(tmp_path):
    """``./sffr-gym`` is what a clone is called: no cache, whatever lies in it, and however old."""
    mine = tmp_path / "sffr-gym" / NAME
    mine.mkdir(parents=True)
    (mine / "thesis.csv").write_text("1,2\n")
    make_old(mine)
    code = "from sffr_gym.compile import cache, folders; cache.remove_stale_caches(); print(folders.ROOTS[0])"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True,
        env=os.environ | {"XDG_CACHE_HOME": "", "NUMBA_CACHE_DIR": "", "HOME": str(tmp_path / "home")},
    )  # fmt: skip
    assert done.stdout.strip() == str(tmp_path / "home" / ".cache" / "sffr-gym")
    assert (mine / "thesis.csv").is_file()

"""Run folders: what holds anything of others is left alone, and a killed process loses nothing that was finished."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from listing import listing

from sffr_gym import ConfigError
from sffr_gym.config.files import check_target
from sffr_gym.config.run_folder import CARD, FORMAT, RunFolder


def finished_run(folder: Path, kind: str = "evaluation") -> Path:
    """Leave a finished run of two files."""
    with RunFolder.claim(folder, kind) as run:
        run.replace({"summary.json": b"old", "recordings/a.npz": b"old a"})
    return folder


def card(folder: Path, **changes: object) -> None:
    """Change what a folder says of itself."""
    file = folder / CARD
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


def foreign_file(folder: Path) -> None:
    """A folder with something in it."""
    folder.mkdir()
    (folder / "thesis.csv").write_text("1,2")


def file_in_place(folder: Path) -> None:
    """A file where the folder should be."""
    folder.write_text("mine")


def other_kind(folder: Path) -> None:
    """A run of another command."""
    finished_run(folder, "training")


def newer_format(folder: Path) -> None:
    """A run of a version to come."""
    card(finished_run(folder), format=FORMAT + 1)


def damaged(folder: Path) -> None:
    """What the folder says of itself was cut."""
    (finished_run(folder) / CARD).write_text('{"kind": "eval')


def leads_out(folder: Path) -> None:
    """Somebody changed the list of files."""
    card(finished_run(folder), files=["../thesis.csv"])


REFUSED: dict[Callable[[Path], None], str] = {
    foreign_file: "is not empty and holds no run of sffr evaluate",
    file_in_place: "is not a folder",
    other_kind: "holds a run of sffr train, not of sffr evaluate",
    newer_format: "was written by a newer version",
    damaged: "is no valid JSON",
    leads_out: "leads out of the folder",
}


@pytest.mark.parametrize("make", REFUSED)
@pytest.mark.parametrize("overwrite", [False, True])
def test_a_folder_of_others_is_left_as_it_is(tmp_path: Path, make: Callable[[Path], None], overwrite: bool) -> None:
    """Whatever is asked for."""
    make(tmp_path / "run")
    before = listing(tmp_path)
    with pytest.raises(ConfigError, match=REFUSED[make]):
        RunFolder.claim(tmp_path / "run", "evaluation", overwrite=overwrite)
    assert listing(tmp_path) == before


def test_a_finished_run_is_replaced_only_if_asked(tmp_path: Path) -> None:
    """And what lies beside it stays; an empty folder and an unfinished run are taken without asking."""
    folder = finished_run(tmp_path)
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match="holds a finished run; choose another folder with --out or add --overwrite"):
        RunFolder.claim(folder, "evaluation")
    with RunFolder.claim(folder, "evaluation", overwrite=True) as run:
        assert listing(folder)["summary.json"] == b"old"  # until the new run is complete
        run.replace({"summary.json": b"new"}, remove=run.files)
    assert listing(folder).keys() == {CARD, "summary.json", "notes.txt"}
    assert listing(folder)["summary.json"] == b"new"
    card(folder, finished=False)
    RunFolder.claim(folder, "evaluation").release()


def test_no_file_is_replaced_that_the_run_did_not_write(tmp_path: Path) -> None:
    """Also within a folder that is the run's; it is told before anything runs, and again before it would happen."""
    folder = finished_run(tmp_path)
    (folder / "path.png").write_text("mine")
    with RunFolder.claim(folder, "evaluation", overwrite=True) as run:
        run.check_names(["summary.json"])
        for change in (
            lambda: run.check_names(["summary.json", "path.png"]), lambda: run.own("path.png"),
            lambda: run.write("path.png", b""), lambda: run.replace({"path.png": b"", "summary.json": b""}),
        ):  # fmt: skip
            with pytest.raises(ConfigError, match=r"path\.png: is there, and was not written by this run"):
                change()
        run.replace({}, remove=["path.png"])
    assert (folder / "path.png").read_text() == "mine" and (folder / "summary.json").read_text() == "old"


def test_a_link_does_not_lead_out_of_a_run_folder(tmp_path: Path) -> None:
    """Somebody's unpacked archive may hold one."""
    folder = finished_run(tmp_path / "run")
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "b.npz").write_text("mine")
    (folder / "elsewhere").symlink_to(tmp_path / "home")
    card(folder, files=["elsewhere/b.npz"])
    with pytest.raises(ConfigError, match="leads out of the run folder"):
        RunFolder.claim(folder, "evaluation", overwrite=True)
    assert (tmp_path / "home" / "b.npz").read_text() == "mine"


def test_a_shared_folder_keeps_what_is_of_others(tmp_path: Path) -> None:
    """Pages are put beside a project's own."""
    (tmp_path / "index.md").write_text("mine")
    (tmp_path / "results.md").write_text("mine too")
    with RunFolder.claim(tmp_path, "pages", shared=True) as run:
        run.write("images/a.png", b"picture")
        with pytest.raises(ConfigError, match=r"results\.md: is there"):
            run.write("results.md", b"page")
    assert listing(tmp_path).keys() == {CARD, "index.md", "results.md", "images/a.png"}


def test_only_one_process_writes_to_a_folder(tmp_path: Path) -> None:
    """The other is told at once; a process that was killed is no hindrance."""
    code = (
        "import sys, time; from pathlib import Path; from sffr_gym.config.run_folder import RunFolder\n"
        "run = RunFolder.claim(Path(sys.argv[1]), 'training'); print('mine', flush=True); time.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "mine\n"
        with pytest.raises(ConfigError, match="another process is writing to it"):
            RunFolder.claim(tmp_path, "training", resume=True)
        assert RunFolder.open(tmp_path, "training", finished=False).kind == "training"
        other.kill()
    RunFolder.claim(tmp_path, "training", resume=True).release()


def replace_and_die(folder: Path, operations: int) -> bool:
    """Replace a run in a process that is killed before its n-th operation on a file; return whether it got through."""
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1] == 0
    left = operations

    def killing(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            nonlocal left
            left -= 1
            if left < 0:
                os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments, **named)

        return call

    run = RunFolder.claim(folder, "evaluation", overwrite=True)
    for owner, name in (os, "replace"), (Path, "write_bytes"), (Path, "unlink"):
        setattr(owner, name, killing(getattr(owner, name)))
    run.replace({"summary.json": b"new", "recordings/b.npz": b"new b"}, remove=run.files)
    os._exit(0)


def test_a_run_killed_at_any_moment_is_the_old_one_or_the_new_one(tmp_path: Path) -> None:
    """At each operation on a file of which a replacement consists, as whoever opens the folder next finds it."""
    through, seen = False, set()
    for operations in range(100):
        folder = finished_run(tmp_path / str(operations))
        through = replace_and_die(folder, operations)
        read = RunFolder.open(folder, "evaluation")
        found = {name: read.file(name) for name in ("summary.json", "recordings/a.npz", "recordings/b.npz")}
        contents = {name: file.read_bytes() for name, file in found.items() if file.exists()}
        new = contents["summary.json"] == b"new"
        seen.add(new)
        if new:
            assert contents["recordings/b.npz"] == b"new b"
            assert set(read.files) == {"summary.json", "recordings/b.npz"}
        else:
            assert contents == {"summary.json": b"old", "recordings/a.npz": b"old a"}
        RunFolder.claim(folder, "evaluation", overwrite=True).release()
        left = {name.rpartition("/")[2] for name in listing(folder)}
        assert not {name for name in left if name.startswith(".")}
        if through:
            break
    assert through and new and seen == {False, True} and operations > 10
    assert listing(folder).keys() == {CARD, "summary.json", "recordings/b.npz"}


def test_a_reader_is_told_what_it_is_not(tmp_path: Path) -> None:
    """A folder without a run, of another kind, or unfinished."""
    with pytest.raises(
        ConfigError, match=r"holds no run of sffr evaluate or sffr benchmark \(sffr-run.json is missing"
    ):
        RunFolder.open(tmp_path, "evaluation", "benchmark")
    finished_run(tmp_path, "training")
    with pytest.raises(ConfigError, match="holds a run of sffr train, not of sffr evaluate"):
        RunFolder.open(tmp_path, "evaluation")
    card(tmp_path, finished=False)
    with pytest.raises(ConfigError, match="holds a run of sffr train that is not finished"):
        RunFolder.open(tmp_path, "training")


def test_a_target_is_checked_before_anything_runs(tmp_path: Path) -> None:
    """A file that is there is replaced if asked; a folder never."""
    (tmp_path / "a.png").write_text("mine")
    check_target(tmp_path / "new" / "a.png")
    check_target(tmp_path / "a.png", overwrite=True)
    for file, message in (
        (tmp_path / "a.png", "is there already; choose another name with --out or add --overwrite"),
        (tmp_path, "is a folder"), (tmp_path / "a.png" / "b.png", "a.png is not a folder"),
        (Path("a\0b"), "is no name of a file"), (tmp_path / ("x" * 252), "is no name of a file: .* too long"),
        (tmp_path / "new" / ("x" * 252), "is no name of a file: .* too long"),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match=message):
            check_target(file)

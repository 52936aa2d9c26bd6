"""Every command that writes, killed at random moments, and told to stop: nothing finished is lost, nothing stays."""

import json
import re
import resource
import shutil
import signal
import subprocess

import pytest
from killing import contents, has_card, kill_at_random, run_whole, started

from sffr_gym.config.provenance import MANIFEST
from sffr_gym.config.run_folder import CARD, RunFolder
from sffr_workbench.evaluation import SUMMARY_FILE, read_episodes

SHORT = "{{name: short, description: A test's., duration: {}, panel_modes: [{{mode: 1, amplitude: [0.05, 0.25]}}]}}"
TIMES = ("started", "duration_s")  # what differs between two runs
EVALUATE = ["evaluate", "none", "ahsc", "-s", "short.yaml", "-n", 3, "--out", "run"]
BENCHMARK = ["benchmark", "hsc", "ahsc", "-s", "short.yaml", "-n", 6, "-j", 2, "--out", "run"]
VERIFY = ["verify", "--quick", "--section", "coupling", "--out", "run"]
REPRODUCE = ["reproduce", "--duration", 1.0, "--out", "run"]
ANIMATE = ["animate", "ahsc", "-s", "short.yaml", "--out", "movie.gif", "--size", 200]
TUNE = ["tune-law", "hsc-tuned", "-s", "short.yaml", "-n", 1, "--evaluations", 6, "--out", "tuned.yaml"]


def scenario(seconds=1.0):
    """Return what writes a scenario of so many seconds into a try's folder."""
    return lambda folder: (folder / "short.yaml").write_text(SHORT.format(seconds))


def has_row(folder):
    """Say whether workers have finished an episode."""
    return any((folder / "run" / "rows").rglob("[0-9]*.json"))


def outcome(folder):
    """What a run leaves, without when and how long it ran."""
    found = contents(folder / "run", without=[MANIFEST, CARD])
    facts = json.loads((folder / "run" / MANIFEST).read_text())
    card = json.loads((folder / "run" / CARD).read_text())
    return found, {key: value for key, value in facts.items() if key not in TIMES}, card | {"files": {*card["files"]}}


@pytest.mark.slow
def test_killed_evaluations_start_again(tmp_path):
    """Nothing is there before all of it is; the same command needs no --overwrite."""
    kill_at_random(tmp_path, EVALUATE, outcome, kills=4, seed=1, prepare=scenario())


@pytest.mark.slow
def test_killed_replacements_leave_the_old_run_or_the_new_one(tmp_path):
    """Each whole."""
    old, seen = tmp_path / "old", []
    scenario()(_made(old))
    assert run_whole(old, "evaluate", "lqr", "-s", "short.yaml", "-n", 1, "--out", "run")[0] == 0

    def prepare(folder):
        shutil.copytree(old, folder, dirs_exist_ok=True)

    def check(folder):
        run = RunFolder.open(folder / "run", "evaluation")
        policies = {result.policy for result in read_episodes(run)}
        assert policies == set(json.loads(run.file(SUMMARY_FILE).read_text())["policies"])
        recordings = {name for name in run.files if name.startswith("recordings/")}
        assert recordings == {f"recordings/{policy}.npz" for policy in policies}
        assert all(run.file(name).is_file() for name in run.files)
        seen.append(policies)

    def replaced(folder):
        found, facts, card = outcome(folder)
        return {name: found[name] for name in card["files"] if name in found}, facts

    kill_at_random(
        tmp_path, [*EVALUATE, "--overwrite"], replaced, kills=5, seed=2, prepare=prepare, check=check,
        alive=lambda folder: True,
    )  # fmt: skip
    assert {"lqr"} in seen


@pytest.mark.slow
def test_killed_benchmarks_go_on(tmp_path):
    """Workers end by themselves, and what was finished is not run again."""
    kept = {}

    def check(folder):
        kept.update({file: file.stat().st_mtime_ns for file in (folder / "run" / "rows").rglob("[0-9]*.json")})

    kill_at_random(tmp_path, BENCHMARK, outcome, kills=5, seed=3, prepare=scenario(3.0), check=check)
    assert kept and all(file.stat().st_mtime_ns == when for file, when in kept.items())


@pytest.mark.slow
def test_killed_reports_leave_the_run_as_it_is(tmp_path):
    """The page is there, whole, or it is not."""
    old = _made(tmp_path / "old")
    scenario()(old)
    assert run_whole(old, *EVALUATE)[0] == 0
    kill_at_random(
        tmp_path, ["report", "run", "--overwrite"], outcome, kills=3, seed=4, alive=lambda folder: True,
        prepare=lambda folder: shutil.copytree(old, folder, dirs_exist_ok=True),
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("arguments", "file"), [(ANIMATE, "movie.gif"), (TUNE, "tuned.yaml")], ids=["animate", "tune"])
def test_killed_commands_of_one_file_leave_it_whole(tmp_path, arguments, file):
    kill_at_random(
        tmp_path, arguments, lambda folder: contents(folder), kills=3, seed=5, prepare=scenario(),
        alive=lambda folder: True,
    )  # fmt: skip
    assert (tmp_path / "whole" / file).is_file()


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [VERIFY, REPRODUCE], ids=["verify", "reproduce"])
def test_killed_pages_are_written_whole(tmp_path, arguments):
    """But for the times that they tell."""

    def pages(folder):
        texts = contents(folder / "run")
        times = rb"\b[\d.]+ (s|times real time)\b"
        return {name: re.sub(times, b"", text) for name, text in texts.items() if name.endswith(".html")}

    kill_at_random(tmp_path, arguments, pages, kills=2, seed=6)


@pytest.mark.slow
def test_killed_measurements_start_again(tmp_path):
    arguments = ["bench", "--quick", "--only", "loop", "--out", "run"]
    kill_at_random(tmp_path, arguments, lambda folder: set(contents(folder / "run")), kills=2, seed=7)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("arguments", "advice"),
    [
        (EVALUATE, "nothing was written to run, and the same command starts again"),
        ([*BENCHMARK, "--no-figures"], "what was finished is kept in run, and the same command goes on"),
        (VERIFY, "nothing was written to run"),
    ],
    ids=["evaluate", "benchmark", "verify"],
)
def test_commands_that_are_told_to_stop_say_what_is_left(tmp_path, arguments, advice, number):
    """On their own word, workers and all."""
    scenario(30.0)(tmp_path)
    with started(tmp_path, *arguments) as command:
        assert command.wait_until(has_row if "benchmark" in arguments else has_card)
        assert command.stop(number) == (128 + number, f"interrupted; {advice}\n")


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [EVALUATE, BENCHMARK], ids=["evaluate", "benchmark"])
def test_only_one_command_writes_to_a_folder(tmp_path, arguments):
    """The second is told at once, and the first does not notice."""
    scenario(5.0)(tmp_path)
    with started(tmp_path, *arguments) as first:
        assert first.wait_until(has_card)
        code, errors = run_whole(tmp_path, *arguments)
        assert code == 2 and "another process is writing to it" in errors
        assert first.end()[0] == 0


@pytest.mark.slow
def test_a_reader_that_leaves_is_no_error(tmp_path):
    """As ``| head`` does."""
    scenario()(tmp_path)
    with started(tmp_path, *EVALUATE, stdout=subprocess.PIPE) as command:
        command.process.stdout.close()
        command.process.stdout = None
        _, errors = command.end()
    assert "Traceback" not in errors and "error" not in errors
    assert len(read_episodes(tmp_path / "run")) == 6


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [EVALUATE, BENCHMARK], ids=["evaluate", "benchmark"])
def test_a_full_disk_is_an_error_in_one_line(tmp_path, arguments):
    """No file may become larger than 500 bytes here."""
    scenario()(tmp_path)

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))

    with started(tmp_path, *arguments, preexec_fn=limit) as command:
        code, errors = command.end()
    lines = [line for line in errors.splitlines() if line.startswith("error:")]
    assert code == 2 and len(lines) == 1 and "File too large" in lines[0] and "run/" in lines[0], errors
    assert "Traceback" not in errors
    assert run_whole(tmp_path, *arguments)[0] == 0


def _made(folder):
    folder.mkdir(parents=True, exist_ok=True)
    return folder

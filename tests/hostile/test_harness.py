"""The harness notices what is wrong, keeps it, and goes on."""

import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from campaign import again, report, run
from fakes import WRONG, Fakes
from kinds import FAKES
from pool import Figures, Worker
from trial import Trial
from worker import INPUT, try_all


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    """One process for all, or as many as die."""
    folder = tmp_path_factory.mktemp("worker")
    made = Worker(Fakes(), folder, folder / "scratch")
    yield made
    made.stop()


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> Figures:
    """Some fakes, drawn at random."""
    (found,) = run([FAKES], trials=30, workers=2, failures=tmp_path_factory.mktemp("failures"), quiet=True)
    return found


def outcome(worker: Worker, name: str, folder: Path) -> dict[str, Any]:
    """What comes of a fake."""
    (folder / INPUT).write_bytes(pickle.dumps(Trial(name, name, {"outside.txt": b"mine"})))
    (message,) = worker.messages({"input": str(folder / INPUT)})
    assert message["story"] == name
    return message["end"]


@pytest.mark.parametrize("name", WRONG)
def test_a_violation_is_found(name: str, worker: Worker, tmp_path: Path) -> None:
    """Whether a trial raises, crashes, hangs, grows or says the wrong thing."""
    end = outcome(worker, name, tmp_path)
    assert end["outcome"] == "violation"
    assert WRONG[name][1] in end["error"]


@pytest.mark.parametrize(("name", "expected"), [("work", "worked"), ("refuse", "refused")])
def test_what_is_right_is_none(name: str, expected: str, worker: Worker, tmp_path: Path) -> None:
    """After whatever went before."""
    end = outcome(worker, name, tmp_path)
    assert (end["outcome"], end["error"]) == (expected, "")


def test_the_figures_count_every_trial(figures: Figures) -> None:
    """Those too whose workers died."""
    assert figures.trials == figures.worked + figures.refused + len(figures.found) == 30
    assert figures.worked == figures.counts["work"] > 0
    assert {found.story for found in figures.found} <= WRONG.keys()
    text = report([figures], "campaign")
    assert f"| fakes | 30 | {figures.refused} | {figures.worked} | {len(figures.found)} |" in text
    assert figures.found and figures.found[0].folder.name in text


def test_the_input_of_a_violation_is_kept_and_can_be_tried_again(
    figures: Figures, capsys: pytest.CaptureFixture[str]
) -> None:
    """With its files, and what happened."""
    for found in figures.found:
        assert (found.folder / INPUT).exists() and found.story in (found.folder / "story.txt").read_text()
        assert (found.folder / "trial" / "outside.txt").exists() == (found.story != "remove")
    again(figures.found[0].folder)
    assert WRONG[figures.found[0].story][1] in capsys.readouterr().out


@pytest.mark.parametrize(("other", "same"), [(3, True), (4, False)])
def test_a_seed_stands_for_its_trials(other: int, same: bool) -> None:
    """Else nobody could repeat what was found."""
    one: list[str] = []
    two: list[str] = []
    try_all(Fakes(), 3, 20, lambda trial: one.append(trial.story))
    try_all(Fakes(), other, 20, lambda trial: two.append(trial.story))
    assert len(one) == 20
    assert (one == two) == same

"""Tampered checkpoints of trainings that were interrupted, under ``train --resume`` and ``export``."""

from __future__ import annotations

import shutil
from pathlib import Path

from command import sffr
from hypothesis import strategies as st
from small_training import small
from spoil import changed_tree
from trial import Trial, check_unchanged, fingerprint, read_tree

from sffr_agents.train import train
from sffr_baselines.learned import load_schedule

ALGOS = ("ppo", "sac")
STOP = 140  # steps after which the exemplars were interrupted; two checkpoints are there


class Checkpoints:
    """Checkpoints of others."""

    name = "checkpoints"
    most_seconds, most_memory = 10.0, 1e9

    def make_exemplars(self, folder: Path) -> None:
        """Interrupt a small training of each algorithm."""

        def stop(done: int, total: int, scores: dict[str, float]) -> None:
            if done >= STOP:
                raise KeyboardInterrupt

        for algo in ALGOS:
            try:
                train(small(algo), 0, folder / algo, stop)
            except KeyboardInterrupt:
                continue

    def load(self, folder: Path) -> None:
        """Read the exemplars, and resume each as it is."""
        self._trees = {algo: read_tree(folder / algo) for algo in ALGOS}
        for algo in ALGOS:
            shutil.copytree(folder / algo, "whole")
            assert sffr("train", "--resume", "--quiet", "-o", "whole") == "worked"
            shutil.rmtree("whole")

    def trials(self) -> st.SearchStrategy[Trial]:
        """Draw a folder."""

        def of(algo: str, command: str) -> st.SearchStrategy[Trial]:
            made = changed_tree(self._trees[algo], ("checkpoints/",))
            return made.map(
                lambda made: Trial(
                    f"{command} {algo}: {made[1]}", command,
                    {f"run/{name}": content for name, content in made[0].items()} | {"outside/secret.txt": b"mine"},
                )
            )  # fmt: skip

        commands = st.sampled_from(["resume", "resume", "resume", "export"])
        return st.tuples(st.sampled_from(ALGOS), commands).flatmap(lambda drawn: of(*drawn))

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Resume or export it."""
        run, out = folder / "run", folder / "out.npz"
        before = fingerprint(folder, ("run",) if trial.target == "resume" else ())
        if trial.target == "resume":
            outcome, policy = sffr("train", "--resume", "--quiet", "-o", run, places=[str(run)]), run / "best.npz"
        else:
            outcome, policy = sffr("export", run, "-o", out, places=[str(run)]), out
        if outcome == "worked":
            load_schedule(policy)
        check_unchanged(
            before, fingerprint(folder, ("run", "out.npz") if trial.target == "resume" else ("out.npz",)), "files"
        )
        return outcome, {f"{trial.target} {outcome}": 1}

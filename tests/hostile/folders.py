"""Tampered run folders of every kind, under all commands that read them and those that go on with them."""

from __future__ import annotations

import shutil
from pathlib import Path

import yaml
from command import sffr, write_scenario
from hypothesis import strategies as st
from small_training import PPO_SMALL
from spoil import changed_tree
from trial import Trial, check_unchanged, fingerprint, read_tree

from sffr_baselines.learned import shipped_policies

COMMANDS = {  # of each run; those that simulate are slow, and tried less often
    "evaluation": ["report"] * 6 + ["compare"] * 4 + ["evaluate"],
    "benchmark": ["report"] * 3 + ["compare"] * 3 + ["seeds"] * 3 + ["benchmark"] * 2,
    "training": ["curves"] * 3 + ["export", "resume"],
    "search": ["tune"],
}
WRITING = ("evaluate", "benchmark", "resume", "tune")
FOREIGN = {"outside/secret.txt": b"mine", "run/thesis.txt": b"mine", "run/recordings/thesis.npz": b"mine"}
PLAN = {
    "train": "ppo", "set": PPO_SMALL, "seeds": 1, "trials": 2,
    "space": [{"key": "learning.gamma", "low": 0.95, "high": 0.99}],
}  # fmt: skip


class Folders:
    """Run folders of others."""

    name = "folders"
    most_seconds, most_memory = 10.0, 1e9

    def make_exemplars(self, folder: Path) -> None:
        """Let the commands leave small runs."""
        self._locate(folder)
        write_scenario(folder, duration=0.4)
        for k in range(2):
            (folder / f"ppo-{k}").mkdir()
            shutil.copy(shipped_policies()["ppo"], folder / f"ppo-{k}" / "best.npz")
        (folder / "search.yaml").write_text(yaml.safe_dump(PLAN))
        changes = [part for change in PPO_SMALL for part in ("--set", change)]
        for arguments in (
            ["evaluate", "ahsc", "none", "-s", self._scenario, "-n", 2, "-o", folder / "evaluation"],
            [*self._benchmark, "-o", folder / "benchmark"],
            ["train", "-o", folder / "training", *changes],
            ["tune", self._search, "-o", folder / "search"],
        ):
            assert sffr(*arguments, "--quiet") == "worked"

    def load(self, folder: Path) -> None:
        """Read the exemplars, and run every command with them as they are."""
        self._locate(folder)
        self._trees = {run: read_tree(folder / run) for run in COMMANDS}
        for run, commands in COMMANDS.items():
            for command in dict.fromkeys(commands):
                shutil.copytree(folder / run, "whole/run")
                assert self._run(command, Path("whole")) == "worked", (run, command)
                shutil.rmtree("whole")

    def _locate(self, folder: Path) -> None:
        self._folder, self._scenario, self._search = folder, folder / "short.yaml", folder / "search.yaml"
        seeds = [folder / f"ppo-{k}" / "best.npz" for k in range(2)]
        self._benchmark = ["benchmark", "ahsc", *seeds, "-s", self._scenario, "-n", 2, "-j", 1, "--no-figures"]

    def trials(self) -> st.SearchStrategy[Trial]:
        """Draw a folder and what is done with it."""

        def of(run: str, command: str) -> st.SearchStrategy[Trial]:
            return changed_tree(self._trees[run]).map(
                lambda made: Trial(
                    f"{command} {run}: {made[1]}", command,
                    {f"run/{name}": content for name, content in made[0].items()} | FOREIGN,
                )
            )  # fmt: skip

        pairs = st.sampled_from(sorted(COMMANDS)).flatmap(
            lambda run: st.tuples(st.just(run), st.sampled_from(COMMANDS[run]))
        )
        return pairs.flatmap(lambda drawn: of(*drawn))

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Do it, and see whether files changed that it had no business with."""
        reads = trial.target not in WRITING
        before = fingerprint(folder) if reads else self._foreign(folder)
        outcome = self._run(trial.target, folder)
        after = fingerprint(folder, ("out", "out.npz")) if reads else self._foreign(folder)
        check_unchanged(before, after, "files" if reads else "files of others")
        return outcome, {f"{trial.target} {outcome}": 1}

    def _foreign(self, folder: Path) -> dict[str, object]:
        found = fingerprint(folder)
        return {name: content for name, content in found.items() if name in FOREIGN or not name.startswith("run")}

    def _run(self, command: str, folder: Path) -> str:
        run, out = folder.absolute() / "run", folder.absolute() / "out"
        whole = self._folder / ("evaluation" if (run / "summary.json").exists() else "benchmark")
        arguments = {
            "report": ["report", run, "-o", out / "page.html", "--quiet"],
            "compare": ["compare", run, whole],
            "seeds": ["seeds", run],
            "curves": ["curves", run, "-o", out / "curves.png"],
            "export": ["export", run, "-o", out.with_suffix(".npz")],
            "evaluate": ["evaluate", "ahsc", "-s", self._scenario, "-n", 1, "-o", run, "--overwrite", "--quiet"],
            "benchmark": [*self._benchmark, "-o", run, "--quiet"],
            "resume": ["train", "--resume", "-o", run, "--quiet"],
            "tune": ["tune", self._search, "-o", run, "--quiet"],
        }[command]
        if command == "export":
            out = out.with_suffix(".npz")
        return sffr(*arguments, places=[str(run)])

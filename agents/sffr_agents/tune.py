"""Search for the settings of a training: every trial trains with several seeds and counts by all of their episodes."""

from __future__ import annotations

import csv
import io
import json
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import optuna
import yaml
from optuna.trial import FrozenTrial
from pydantic import Field

from sffr_agents.config import TrainConfig
from sffr_agents.folder import BEST, Tell, first_difference, writing
from sffr_agents.shared_study import is_database, open_shared
from sffr_agents.study import Trials, locked, open_trials
from sffr_agents.train import TrainingProgress, train_or_resume
from sffr_agents.tune_config import TuneConfig, Value
from sffr_agents.validation import Validator
from sffr_baselines.learned import load_schedule
from sffr_gym.config.files import to_json
from sffr_gym.config.reading import read_json
from sffr_gym.config.run_folder import CARD, LOCK, RunFolder
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import ConfigError, build
from sffr_gym.task.statistics import interquartile_mean
from sffr_gym.types import Array

PLAN, TRIALS, BEST_CONFIG, STUDY, TRAININGS = "tune.json", "trials.csv", "best.yaml", "study.journal", "trainings"
KIND = "search"  # of the run folder
OWN = (PLAN, TRIALS, BEST_CONFIG, TRAININGS, CARD, LOCK)  # names in it that the file of trials cannot have

TuningProgress = Callable[[str, int, int], Any]  # what runs, trainings done and in all


class Search(Section):
    """What ``tune.json`` says, which tells a search from others; more trials than before are welcome."""

    seed: int = Field(ge=0, description="of the search itself")
    plan: dict[str, Any] = Field(description="what is searched, but for the number of trials; see TuneConfig")

    @classmethod
    def of(cls, plan: TuneConfig, seed: int) -> dict[str, Any]:
        """Return the plain values of a search; raises ConfigError for a seed that is not valid."""
        values = {name: value for name, value in plan.model_dump(mode="json").items() if name != "trials"}
        return build(cls, {"seed": seed, "plan": values}, lambda key: "search").model_dump(mode="json")


def tune(
    plan: TuneConfig,
    out: Path,
    storage: Path | str | None = None,
    seed: int = 0,
    progress: TuningProgress | None = None,
    tell: Tell = warnings.warn,
) -> FrozenTrial:
    """Run what is missing of a search; the same call resumes one that was killed, in the middle of a training too.

    One process at a time may work on a search, and on a file of trials.

    Args:
        plan: what to search.
        out: folder of the trainings, of ``trials.csv`` and of ``best.yaml``, the configuration of the best trial.
        storage: file of the trials: an SQLite database if its suffix says so, else a journal; None for one in ``out``;
            or the address of a database, such as ``postgresql+psycopg://user@host/trials``, at which several
            machines may search together, each with a folder of its own.
        seed: of the search itself.
        progress: called with what runs, the trainings done and all of them.
        tell: called with a line for each checkpoint of a training that is damaged.

    Returns:
        The best trial.

    Raises:
        ConfigError: if the folder or the file holds anything else, is damaged or cannot be written, or another process
            writes to it.
    """
    search, progress = Search.of(plan, seed), progress or (lambda what, done, total: None)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    file = None if storage is None or is_database(storage) else Path(storage)
    if file is not None and file.absolute().parent == out.absolute() and file.name in OWN:
        raise ConfigError(f"{file}: is the name of another file of the search; choose another --storage")
    with RunFolder.claim(out, KIND, resume=True) as run, locked(file) if file else nullcontext():
        _begin(run, search)
        with (
            open_shared(str(storage), search, plan.space)
            if is_database(storage)
            else open_trials(file or run.place(STUDY), search, plan.space)
        ) as trials:
            with writing(out, lambda: f"{len(trials.finished())} finished trials are kept; the same command goes on"):
                _run_missing(run, plan, trials, seed, progress, tell)
            return trials.best()


def _begin(run: RunFolder, search: dict[str, Any]) -> None:
    """Make the folder this search's; raises ConfigError if it holds another one."""
    file = run.file(PLAN)
    if file.exists():
        data = read_json(file)
        if not isinstance(data, dict):
            raise ConfigError(f"{file}: must hold a mapping of keys to values")
        held = build(Search, data, lambda key: str(file)).model_dump(mode="json")
        if found := first_difference(held, search):
            key, own, asked = found
            raise ConfigError(
                f"{run.path}: holds another search: {key} = {own!r}, not {asked!r}; choose another folder with --out"
            )
    run.own(TRIALS, BEST_CONFIG, STUDY, TRAININGS)
    if not file.exists():
        run.write(PLAN, to_json(search).encode())


def _run_missing(
    run: RunFolder, plan: TuneConfig, trials: Trials, seed: int, progress: TuningProgress, tell: Tell
) -> None:
    """Run the trials that are missing."""
    while (done := len(trials.finished())) < plan.trials:
        if run.finished:
            run.begin_again()
        values = trials.propose(_untuned_values(plan), seed)
        config = plan.training(values)
        costs = []
        for k in range(plan.seeds):
            what = f"trial {done + 1} of {plan.trials}, seed {k}{_best_so_far(trials)}"
            training = _training_progress(progress, what, done * plan.seeds + k, plan.trials * plan.seeds)
            costs.append(_train_and_score(config, k, run.path, _Report(training, tell)))
        trials.add(values, float(interquartile_mean(np.concatenate(costs))))
        _write_results(run, trials, plan)
    _write_results(run, trials, plan)
    run.finish()


class _Report(NamedTuple):
    """Who is told of a training."""

    progress: TrainingProgress
    tell: Tell  #: of damaged checkpoints


def _train_and_score(config: TrainConfig, seed: int, out: Path, report: _Report) -> Array:
    """Return the costs (episodes, scenarios) of the best policy of one training, which resumes where it was killed."""
    folder = out / TRAININGS / f"{config.hash()}-{seed}"
    train_or_resume(config, seed, folder, report.progress, report.tell)
    return Validator(config.validation, config.environment.robot()).episode_costs(load_schedule(folder / BEST))


def _untuned_values(plan: TuneConfig) -> dict[str, Value]:
    """Return the untuned configuration's values, as far as the search may take them."""
    values: dict[str, Value] = {}
    data = plan.training({}).model_dump(mode="json")
    for dimension in plan.space:
        value: Any = data
        for name in dimension.key.split("."):
            value = value[name]
        if dimension.choices is not None:
            if (text := json.dumps(value)) in dimension.choices or value in dimension.choices:
                values[dimension.key] = text if isinstance(value, list) else value
        elif dimension.ends[0] <= value <= dimension.ends[1]:
            values[dimension.key] = value
    return values


def _best_so_far(trials: Trials) -> str:
    """Return the lowest cost as text, empty if there is none."""
    return f", best cost {trials.best().values[0]:.3f}" if trials.finished() else ""


def _training_progress(progress: TuningProgress, what: str, done: int, total: int) -> TrainingProgress:
    """Turn the progress of a training into that of the search."""
    return lambda steps, all_steps, scores: progress(f"{what}, {100.0 * steps / all_steps:.0f} %", done, total)


def _write_results(run: RunFolder, trials: Trials, plan: TuneConfig) -> None:
    """Write all finished trials, the best first, and the configuration of the best one."""
    keys = [dimension.key for dimension in plan.space]
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["trial", "cost", *keys])
    for trial in sorted(trials.finished(), key=lambda trial: float(trial.values[0])):
        table.writerow([trial.number, trial.values[0], *(trial.params[key] for key in keys)])
    best = trials.best()
    config = plan.training(best.params).model_dump(mode="json")
    about = f"# Trial {best.number} of sffr tune: cost {best.values[0]:.4f} over {plan.seeds} seeds.\n"
    run.write(TRIALS, text.getvalue().encode())
    run.write(BEST_CONFIG, (about + yaml.safe_dump(config, sort_keys=False)).encode())

"""Search for the settings of a training: every trial trains with several seeds and counts by all of their episodes."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import yaml
from optuna.storages import BaseStorage, JournalStorage, RDBStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, Trial, TrialState

from sffr_agents.config import TrainConfig
from sffr_agents.folder import BEST, holds_run
from sffr_agents.train import TrainingProgress, resume, train
from sffr_agents.tune_config import Dimension, TuneConfig, Value
from sffr_agents.validation import Validator
from sffr_baselines.learned import load_schedule
from sffr_gym.config.files import to_json, write_whole
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.arguments import resolve_params
from sffr_gym.task.statistics import interquartile_mean
from sffr_gym.types import Array

PLAN, TRIALS, BEST_CONFIG, STUDY = "tune.json", "trials.csv", "best.yaml", "study.journal"
DATABASES = (".db", ".sqlite", ".sqlite3")

TuningProgress = Callable[[str, int, int], Any]  # what runs, trainings done and in all


def tune(
    plan: TuneConfig, out: Path, storage: Path | None = None, seed: int = 0, progress: TuningProgress | None = None
) -> FrozenTrial:
    """Run what is missing of a search; the same call resumes one that was killed, in the middle of a training too.

    One process at a time may work on a search.

    Args:
        plan: what to search.
        out: folder of the trainings, of ``trials.csv`` and of ``best.yaml``, the configuration of the best trial.
        storage: file of the trials: an SQLite database if its suffix says so, else a journal; None for one in ``out``.
        seed: of the search itself.
        progress: called with what runs, the trainings done and all of them.

    Returns:
        The best trial.

    Raises:
        ConfigError: if the folder holds another search.
    """
    progress = progress or (lambda what, done, total: None)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    out.mkdir(parents=True, exist_ok=True)
    _claim_folder(plan, out)
    study = optuna.create_study(storage=_storage(storage or out / STUDY), study_name="sffr", load_if_exists=True)
    _resume_trials(study, plan)
    while (done := len(_finished(study))) < plan.trials:
        study.sampler = optuna.samplers.TPESampler(seed=seed + len(study.trials))  # a trial depends on those before it
        trial = study.ask()
        values = {dimension.key: _suggest(trial, dimension) for dimension in plan.space}
        config = plan.training(values)
        costs = []
        for k in range(plan.seeds):
            what = f"trial {done + 1} of {plan.trials}, seed {k}{_best_so_far(study)}"
            training = _training_progress(progress, what, done * plan.seeds + k, plan.trials * plan.seeds)
            costs.append(_train_and_score(config, k, out, training))
        study.tell(trial, float(interquartile_mean(np.concatenate(costs))))
        _write_results(study, plan, out)
    _write_results(study, plan, out)
    return study.best_trial


def _train_and_score(config: TrainConfig, seed: int, out: Path, progress: TrainingProgress) -> Array:
    """Return the costs (episodes, scenarios) of the best policy of one training, which resumes where it was killed."""
    folder = out / "trainings" / f"{config.hash()}-{seed}"
    if holds_run(folder):
        resume(folder, progress)
    else:
        train(config, seed, folder, progress)
    params = resolve_params(None, config.environment.overrides)
    return Validator(config.validation, params).episode_costs(load_schedule(folder / BEST))


def _resume_trials(study: optuna.Study, plan: TuneConfig) -> None:
    """Begin with the settings as they are; queue a trial again that died with its process."""
    if not study.trials:
        study.enqueue_trial(_untuned_values(plan))
    for trial in study.get_trials(states=(TrialState.RUNNING,)):
        study.tell(trial.number, state=TrialState.FAIL)
        study.enqueue_trial(trial.params)


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


def _suggest(trial: Trial, dimension: Dimension) -> Value:
    """Return a value of a setting for a trial."""
    if dimension.choices is not None:
        choice: Value = trial.suggest_categorical(dimension.key, dimension.choices)  # type: ignore[assignment]
        return choice
    low, high = dimension.low, dimension.high
    assert low is not None and high is not None  # the model has checked it
    if dimension.whole:
        return trial.suggest_int(dimension.key, int(low), int(high), log=dimension.log)
    return trial.suggest_float(dimension.key, low, high, log=dimension.log)


def _storage(file: Path) -> BaseStorage:
    """Return an SQLite database for the suffixes of one, else a journal."""
    file.absolute().parent.mkdir(parents=True, exist_ok=True)
    if file.suffix in DATABASES:
        return RDBStorage(f"sqlite:///{file.absolute()}")
    return JournalStorage(JournalFileBackend(str(file)))


def _claim_folder(plan: TuneConfig, out: Path) -> None:
    """Make the folder this search's; more trials than before are welcome.

    Raises:
        ConfigError: if it holds another one.
    """
    file, values = out / PLAN, {name: value for name, value in plan.model_dump(mode="json").items() if name != "trials"}
    if file.exists() and json.loads(file.read_text(encoding="utf-8")) != values:
        raise ConfigError(f"{out}: holds another search; choose another folder with --out")
    write_whole(file, to_json(values).encode())


def _finished(study: optuna.Study) -> list[FrozenTrial]:
    """Return the trials that have a cost."""
    return study.get_trials(states=(TrialState.COMPLETE,))


def _best_so_far(study: optuna.Study) -> str:
    """Return the lowest cost as text, empty if there is none."""
    return f", best cost {study.best_value:.3f}" if _finished(study) else ""


def _training_progress(progress: TuningProgress, what: str, done: int, total: int) -> TrainingProgress:
    """Turn the progress of a training into that of the search."""
    return lambda steps, all_steps, scores: progress(f"{what}, {100.0 * steps / all_steps:.0f} %", done, total)


def _write_results(study: optuna.Study, plan: TuneConfig, out: Path) -> None:
    """Write all finished trials, the best first, and the configuration of the best one."""
    keys = [dimension.key for dimension in plan.space]
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["trial", "cost", *keys])
    for trial in sorted(_finished(study), key=lambda trial: trial.values[0]):
        table.writerow([trial.number, trial.values[0], *(trial.params[key] for key in keys)])
    write_whole(out / TRIALS, text.getvalue().encode())
    best = plan.training(study.best_trial.params).model_dump(mode="json")
    about = f"# Trial {study.best_trial.number} of sffr tune: cost {study.best_value:.4f} over {plan.seeds} seeds.\n"
    write_whole(out / BEST_CONFIG, (about + yaml.safe_dump(best, sort_keys=False)).encode())

"""Training of a damping schedule: configuration, seed and folder in, checkpoints, logs and policies out."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat

from sffr_agents.algorithms import make_model
from sffr_agents.checkpoint import load_checkpoint, save_checkpoint
from sffr_agents.config import VALIDATION_SEED, TrainConfig
from sffr_agents.export import network_of, origin_of
from sffr_agents.folder import BEST, CHECKPOINTS, LAST, PROGRESS, begin_run, finish_run, holds_run, read_run
from sffr_agents.log import CsvLog
from sffr_agents.sb3_vec_env import batch_of
from sffr_agents.validation import Validator
from sffr_baselines.learned import LearnedSchedule, save_schedule
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.provenance import origin
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.task.scenario import EVALUATION_SEED, EpisodeRange

PACKAGES = ("torch", "stable-baselines3", "sb3-contrib")  # whose versions a run keeps beside the usual ones

TrainingProgress = Callable[[int, int, dict[str, float]], Any]  # steps done and in all, the last scores


def train(
    config: TrainConfig, seed: int, out: Path, progress: TrainingProgress | None = None, command: Sequence[str] = ()
) -> dict[str, float]:
    """Train from the beginning.

    Args:
        config: what to train.
        seed: of everything random; the same seed on the same machine gives the same weights.
        out: run folder, which must not hold a run.
        progress: called after every step and every comparison.
        command: the command line, for the manifest.

    Returns:
        The scores of the best policy; see :class:`validation.Validator`.

    Raises:
        ConfigError: for a seed of evaluation or validation, a folder with a run, or a setting that is not valid.
    """
    largest, seed = VALIDATION_SEED - config.n_envs, check_arguments(EpisodeRange, seed=seed).seed
    if seed > largest:
        raise ConfigError(
            f"seed = {seed}: training takes 0 to {largest}; the seeds from {VALIDATION_SEED} up choose the best model, "
            f"and those from {EVALUATION_SEED} up are for evaluation alone"
        )
    if holds_run(out):
        raise ConfigError(f"{out}: holds a training; resume it with --resume, or choose another folder with --out")
    training = _Training(config, seed, out, progress)
    begin_run(out, config, seed, origin(command, datetime.now(UTC), 0.0, PACKAGES))
    return training.run()


def resume(out: Path, progress: TrainingProgress | None = None) -> dict[str, float]:
    """Resume a training that was killed, from its last checkpoint; see :func:`train`.

    Raises:
        ConfigError: if the folder holds no training.
    """
    training = _Training(*read_run(out), out, progress)
    training.restore()
    return training.run()


class _Training(BaseCallback):
    """One training from where its algorithm stands: compares and saves between the rollouts.

    Attributes:
        notes: what a checkpoint keeps of it: steps at the last comparison and checkpoint, scores, time [s].
    """

    def __init__(self, config: TrainConfig, seed: int, out: Path, progress: TrainingProgress | None) -> None:
        super().__init__()
        self._config, self._seed, self._out = config, seed, out
        self._algorithm, self._env = make_model(config, seed)
        self._progress = progress or (lambda done, total, scores: None)
        self._batch = batch_of(self._env)
        self.notes: dict[str, Any] = {"validated": 0, "saved": 0, "best": inf, "scores": {}, "elapsed": 0.0}

    def restore(self) -> None:
        """Go back to the last checkpoint; without one the training starts again."""
        if any((self._out / CHECKPOINTS).glob("[0-9]*")):
            self.notes = load_checkpoint(self._out / CHECKPOINTS, self._algorithm, self._env)

    def run(self) -> dict[str, float]:
        """Train up to the configured number of steps, and return the scores of the best policy."""
        model = self._algorithm
        self._validate = Validator(self._config.validation, self._batch.params)
        self._begun = time.perf_counter() - self.notes["elapsed"]
        model.set_logger(self._make_logger(model.num_timesteps))
        left = self._config.steps - model.num_timesteps
        if left > 0:
            model.learn(left, callback=self, reset_num_timesteps=False)
        if left > 0 or not self.notes["scores"]:
            self._compare()
            self._save()
        model.logger.close()
        finish_run(self._out, self.notes["elapsed"])
        best: dict[str, float] = self.notes["best_scores"]
        return best

    def _on_rollout_start(self) -> None:
        """Compare and save where it is due; the last update is done, the next rollout has not begun."""
        if self._algorithm.num_timesteps - self.notes["validated"] >= self._config.validation.every:
            self._compare()
        if self._algorithm.num_timesteps - self.notes["saved"] >= self._config.checkpoints.every:
            self._save()

    def _on_step(self) -> bool:
        self._progress(self.num_timesteps, self._config.steps, self.notes["scores"])
        return True

    def _compare(self) -> None:
        """Score the policy as it is, keep it if it is the best so far, and log."""
        model = self._algorithm
        about = origin_of(self._config, self._batch.params, seed=self._seed, steps=model.num_timesteps)
        schedule = LearnedSchedule.of(network_of(model), self._batch, about)
        scores = self._validate(schedule)
        self.notes |= {"validated": model.num_timesteps, "scores": scores}
        save_schedule(self._out / LAST, schedule)
        if scores["cost"] < self.notes["best"]:
            self.notes |= {"best": scores["cost"], "best_scores": scores}
            save_schedule(self._out / BEST, schedule)
        for name, value in scores.items():
            model.logger.record(f"score/{name}", value)
        model.logger.record("time/seconds", time.perf_counter() - self._begun)
        model.logger.dump(model.num_timesteps)
        self._progress(model.num_timesteps, self._config.steps, scores)

    def _save(self) -> None:
        """Write a checkpoint."""
        model = self._algorithm
        self.notes |= {"saved": model.num_timesteps, "elapsed": time.perf_counter() - self._begun}
        save_checkpoint(self._out / CHECKPOINTS, model, self._env, self.notes, self._config.checkpoints.keep)

    def _make_logger(self, steps: int) -> Logger:
        """Return a logger to a CSV file, and to TensorBoard's if it is installed."""
        outputs: list[KVWriter] = [CsvLog(self._out / PROGRESS, steps)]
        if importlib.util.find_spec("tensorboard"):
            outputs.append(TensorBoardOutputFormat(str(self._out / "tensorboard")))
        return Logger(str(self._out), outputs)

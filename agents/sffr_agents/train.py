"""Training of a damping schedule: configuration, seed and folder in, checkpoints, logs and policies out."""

from __future__ import annotations

import importlib.util
import time
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from math import isnan
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter, Logger

from sffr_agents.algorithms import make_model
from sffr_agents.checkpoint import (
    WINDOW,
    Notes,
    holds_checkpoint,
    load_checkpoint,
    remove_unfinished,
    save_checkpoint,
)
from sffr_agents.config import TrainConfig
from sffr_agents.export import network_of, origin_of
from sffr_agents.folder import (
    BEST,
    CHECKPOINTS,
    KIND,
    LAST,
    PROGRESS,
    SECONDS,
    TENSORBOARD,
    Tell,
    begin_run,
    check_seed,
    finish_run,
    holds_run,
    read_facts,
    read_run,
    writing,
)
from sffr_agents.log import Board, CsvLog, numbers
from sffr_agents.sb3_vec_env import batch_of
from sffr_agents.validation import Validator
from sffr_baselines.learned import LearnedSchedule, save_schedule
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.provenance import origin
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.task.scenario import EpisodeRange

PACKAGES = ("torch", "stable-baselines3", "sb3-contrib")  # whose versions a run keeps beside the usual ones

TrainingProgress = Callable[[int, int, dict[str, float]], Any]  # steps done and in all, the last scores


def train(
    config: TrainConfig, seed: int, out: Path, progress: TrainingProgress | None = None, command: Sequence[str] = ()
) -> dict[str, float]:
    """Train from the beginning.

    Args:
        config: what to train.
        seed: of everything random; the same seed on the same machine gives the same weights.
        out: run folder, which must not hold anything but a training that was killed before it began.
        progress: called after every step and every comparison.
        command: the command line, for the manifest.

    Returns:
        The scores of the best policy; see :class:`validation.Validator`.

    Raises:
        ConfigError: for a seed of evaluation or validation, a folder with anything in it, one that another process
            writes to or that cannot be written, a setting that is not valid, or weights that have diverged.
    """
    seed = check_arguments(EpisodeRange, seed=seed).seed
    check_seed(config, seed)
    with RunFolder.claim(out, KIND) as run, writing(out, lambda: "nothing has been trained yet"):
        begin_run(run, config, seed, origin(command, datetime.now(UTC), 0.0, PACKAGES))
        return _Training(config, seed, run, progress).run()


def resume(out: Path, progress: TrainingProgress | None = None, tell: Tell = warnings.warn) -> dict[str, float]:
    """Resume a training that was killed, from its last checkpoint that is whole; see :func:`train`.

    Args:
        out: run folder.
        progress: called after every step and every comparison.
        tell: called with a line for each checkpoint that is damaged.

    Raises:
        ConfigError: if the folder holds no training, or a damaged one.
    """
    config, seed = read_run(out)
    with RunFolder.claim(out, KIND, resume=True) as run:
        training = _Training(config, seed, run, progress)
        training.restore(tell)
        return training.run()


def train_or_resume(
    config: TrainConfig, seed: int, out: Path, progress: TrainingProgress | None = None, tell: Tell = warnings.warn
) -> dict[str, float]:
    """Train in a folder, or resume what was killed there; see :func:`train` and :func:`resume`.

    Raises:
        ConfigError: also if the folder holds another training.
    """
    if not holds_run(out):
        return train(config, seed, out, progress)
    if read_run(out) != (config, seed):
        raise ConfigError(f"{out}: holds another training than its name says; move it away first")
    return resume(out, progress, tell)


class _Training(BaseCallback):
    """One training from where its algorithm stands: compares and saves between the rollouts.

    Attributes:
        notes: what the last checkpoint keeps of it, with what has happened since.
    """

    def __init__(self, config: TrainConfig, seed: int, run: RunFolder, progress: TrainingProgress | None) -> None:
        super().__init__()
        self._config, self._seed, self._run = config, seed, run
        self._facts = read_facts(run)  # now: what is damaged must not come up at the end
        self._checkpoints = run.place(CHECKPOINTS)
        self._algorithm, self._env = make_model(config, seed)
        self._algorithm.set_logger(Logger(str(run.path), []))
        self._progress = progress or (lambda done, total, scores: None)
        self._batch = batch_of(self._env)
        self.notes = Notes()

    def restore(self, tell: Tell) -> None:
        """Go back to the last checkpoint that is whole; without any the training starts again."""
        remove_unfinished(self._checkpoints)
        if not holds_checkpoint(self._checkpoints):
            return
        model = self._algorithm
        self.notes = load_checkpoint(self._checkpoints, model, self._env, tell)
        for name, value, excluded in self.notes.pending:
            model.logger.record(name, value, excluded)
        returns, lengths = self._env.episode_returns.dtype.type, self._env.episode_lengths.dtype.type
        episodes = ({"r": returns(r), "l": lengths(length), "t": 0.0} for r, length in self.notes.episodes)
        model.ep_info_buffer, model.ep_success_buffer = deque(episodes, maxlen=WINDOW), deque(maxlen=WINDOW)

    def run(self) -> dict[str, float]:
        """Train up to the configured number of steps, and return the scores of the best policy."""
        left = self._config.steps - self._algorithm.num_timesteps
        if left > 0 or not self.notes.scores:
            if self._run.finished:  # but its last checkpoint is damaged
                self._run.begin_again()
            with writing(self._run.path, self._kept):
                self._train(left)
        if not self._run.finished:
            finish_run(self._run, self._facts, self.notes.elapsed)
        return dict(self.notes.best_scores)

    def _train(self, left: int) -> None:
        """Train for so many steps, compare and save; raises ConfigError if the weights diverge."""
        model = self._algorithm
        self._validate = Validator(self._config.validation, self._config.environment.robot())
        self._begun = time.perf_counter() - self.notes.elapsed
        model.logger.output_formats += self._outputs(model.num_timesteps)
        try:
            if left > 0:
                model.learn(left, callback=self, reset_num_timesteps=False)
            self._compare()
            self._save()
        except ValueError as error:
            if not self._has_diverged(error):
                raise
            raise ConfigError(
                f"{self._run.path}: the training has diverged after {model.num_timesteps:,} steps, its weights are not "
                f"finite any more; lower learning.learning_rate; {self._kept()}"
            ) from None
        finally:
            model.logger.close()

    def _has_diverged(self, error: ValueError) -> bool:
        """Say whether weights that are not finite are the reason of an error; torch finds them in distributions."""
        weights = self._algorithm.policy.parameters()
        return str(error).startswith("Expected parameter") or not all(torch.isfinite(each).all() for each in weights)

    def _kept(self) -> str:
        """Return what a failure leaves, in words."""
        if self.notes.saved == 0:
            return "no checkpoint has been written yet"
        return f"the checkpoint after {self.notes.saved:,} steps is kept, from which --resume goes on"

    def _on_rollout_start(self) -> None:
        """Compare and save where it is due; the last update is done, the next rollout has not begun."""
        if self._algorithm.num_timesteps - self.notes.validated >= self._config.validation.every:
            self._compare()
        if self._algorithm.num_timesteps - self.notes.saved >= self._config.checkpoints.every:
            self._save()

    def _on_step(self) -> bool:
        self._progress(self.num_timesteps, self._config.steps, self.notes.scores)
        return True

    def _compare(self) -> None:
        """Score the policy as it is, keep it if it is the best so far, and log."""
        model = self._algorithm
        about = origin_of(self._config, seed=self._seed, steps=model.num_timesteps)
        schedule = LearnedSchedule.of(network_of(model), self._batch, about)
        scores = self._validate(schedule)
        save_schedule(self._run.place(LAST), schedule)
        best = self.notes.best_scores
        if not best or scores["cost"] < best["cost"] or isnan(best["cost"]):
            best = scores
            save_schedule(self._run.place(BEST), schedule)
        self.notes = self.notes.model_copy(
            update={"validated": model.num_timesteps, "scores": scores, "best_scores": best}
        )
        for name, value in scores.items():
            model.logger.record(f"score/{name}", value)
        model.logger.record(SECONDS, time.perf_counter() - self._begun)
        model.logger.dump(model.num_timesteps)
        self._progress(model.num_timesteps, self._config.steps, scores)

    def _save(self) -> None:
        """Write a checkpoint."""
        model, logger = self._algorithm, self._algorithm.logger
        waiting = numbers(logger.name_to_value)
        notes = self.notes.model_copy(
            update={
                "saved": model.num_timesteps,
                "elapsed": time.perf_counter() - self._begun,
                "pending": tuple((name, value, logger.name_to_excluded[name]) for name, value in waiting.items()),
                "episodes": tuple((float(each["r"]), int(each["l"])) for each in model.ep_info_buffer or ()),
            }
        )
        save_checkpoint(self._checkpoints, model, self._env, notes, self._config.checkpoints.keep)
        self.notes = notes

    def _outputs(self, steps: int) -> list[KVWriter]:
        """Return the logger's outputs: a CSV file, and TensorBoard's if it is installed."""
        outputs: list[KVWriter] = [CsvLog(self._run.place(PROGRESS), steps)]
        if importlib.util.find_spec("tensorboard"):
            outputs.append(Board(self._run.place(TENSORBOARD), steps))
        return outputs

"""Episodes: a policy in an environment from start to end, with everything that measures and pictures need."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sffr_baselines.closed_loop import Record, loop_shapes, make_record, run
from sffr_baselines.control_law import make_states
from sffr_baselines.laws import LawPolicy, OraclePolicy
from sffr_baselines.own_law import OwnPolicy
from sffr_baselines.policies import Policy
from sffr_baselines.stepping import Episodes
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.actuators import state_size
from sffr_gym.task.control_period import observe_states, period_shapes
from sffr_gym.task.episode import Episode
from sffr_gym.task.metrics import instability, measure
from sffr_gym.task.observation import Field
from sffr_gym.task.reference import Reference
from sffr_gym.task.score import Result
from sffr_gym.task.signals import N_SIGNALS
from sffr_gym.task.status import REASONS, RUNNING
from sffr_gym.task.task_model import make_task_model
from sffr_gym.types import Array

STRIDE = 25  # control periods between recorded states: 50 ms at the default period
SIDE_BY_SIDE = 16  # episodes of a law of one's own that are stepped together
PIECE = 2000  # control periods between two reports of progress
LARGEST_RECORD = 2.0  # GiB that an episode may leave: half a day of the case study

Progress = Callable[[int], Any]


@dataclass(frozen=True)
class Trajectory:
    """One episode."""

    policy: str  #: names
    scenario: str
    seed: int  #: of the episode
    period: float  #: control period [s]
    signals: Array  #: (n_ticks, N_SIGNALS) see ``control_period.SIGNALS``
    tips: Array  #: (n_ticks, n_p) each panel's transverse tip displacement at the periods' ends [m]
    t: Array  #: (rows,) times of the recorded states [s]
    p: Array  #: (rows, ...) see :class:`closed_loop.Record`
    v: Array  #: (rows, ...)
    obs: Array  #: (rows, ...)
    applied: Array  #: (rows, ...)
    B_hat: Array  #: (rows, ...)
    q_flex: Array  #: (rows, ...)
    lam: Array  #: (rows, ...)
    episode: Episode  #: what the scenario drew: plant, reference and all the rest
    fields: dict[str, Field]  #: layout of the observation
    failure: str  #: why it ended early; empty if it did not

    @property
    def reference(self) -> Reference:
        """Return the desired motion."""
        return self.episode.reference

    @property
    def drawn(self) -> dict[str, float]:
        """Return the values that the scenario drew."""
        return self.episode.drawn


def rollout(
    env: SFFRFlexEnv, policy: Policy, seed: int, progress: Progress | None = None, stride: int = STRIDE
) -> Trajectory:
    """Run one episode: in the compiled loop if the policy is one of the paper's laws, else step by step.

    Args:
        env: the bare environment.
        policy: any policy.
        seed: of the episode; the same seed gives the same episode to every policy.
        progress: called with the number of control periods done since its last call.
        stride: control periods between recorded states.

    Raises:
        ConfigError: for an episode that would take more memory than ``LARGEST_RECORD``; nothing has run then. Of a law
            of one's own that fails, with file and line.
        ValueError: for a law of a robot that has other observations or actuators, and for a stride that is no whole
            number of control periods.
    """
    report = progress or (lambda _: None)
    if isinstance(policy, OwnPolicy):
        return next(rollouts(env, policy, [seed], report, stride))
    obs, _ = env.reset(seed=seed)
    policy.reset(seed=seed)
    if isinstance(policy, OraclePolicy):
        policy.set_plant(env.plant)
    _check_memory(env, env.ticks, stride)
    if isinstance(policy, LawPolicy):
        record = make_record(env.plant_task, env.ticks, stride)
        done, failure = _run_compiled(env, policy, obs, env.ticks, record, report)
        return _trajectory(env, policy.name, seed, env.episode, record, done, failure)
    ((episode, record, done, failure),) = Episodes(env, [seed]).run(lambda obs: policy(obs[0])[None], stride, report)
    return _trajectory(env, policy.name, seed, episode, record, done, failure)


def rollouts(
    env: SFFRFlexEnv, policy: Policy, seeds: Sequence[int], progress: Progress | None = None, stride: int = STRIDE
) -> Iterator[Trajectory]:
    """Run episodes, of a law of one's own many side by side, and yield each as :func:`rollout` returns it."""
    if not isinstance(policy, OwnPolicy):
        for seed in seeds:
            yield rollout(env, policy, seed, progress, stride)
        return
    for first in range(0, len(seeds), SIDE_BY_SIDE):
        own = list(seeds[first : first + SIDE_BY_SIDE])
        for seed in own:
            env.reset(seed=seed)
            _check_memory(env, env.ticks * len(own), stride)
        policy.begin(own)
        ended = Episodes(env, own).run(policy, stride, progress or (lambda _: None))
        for seed, (episode, record, done, failure) in zip(own, ended, strict=True):
            yield _trajectory(env, policy.name, seed, episode, record, done, failure)


def _trajectory(
    env: SFFRFlexEnv, name: str, seed: int, episode: Episode, record: Record, done: int, failure: str
) -> Trajectory:
    """Return what an episode of ``done`` control periods left."""
    rows = (done - 1) // record.stride + 1
    kept = {field: getattr(record, field)[:rows] for field in Record._fields[3:]}
    return Trajectory(
        policy=name, scenario=env.scenario.name, seed=seed, period=env.plant_task.period,
        signals=record.signals[:done], tips=record.tips[:done],
        t=np.linspace(0.0, (rows - 1) * record.stride * env.plant_task.period, rows), **kept,
        episode=episode, fields=env.fields, failure=failure,
    )  # fmt: skip


def true_observations(trajectory: Trajectory) -> Array:
    """What a policy would have seen at the recorded times (rows, n_o) without noise and delay."""
    plant = make_task_model(trajectory.episode.plant)
    work, signals, obs = new_workspace(period_shapes(plant)), np.zeros(N_SIGNALS), np.zeros_like(trajectory.obs)
    observe_states(plant, trajectory.reference, trajectory.t, trajectory.p, trajectory.v, work, obs, signals)
    return obs


def result_of(trajectory: Trajectory) -> Result:
    """Measure an episode."""
    failure = trajectory.failure or instability(trajectory.signals, trajectory.period)
    path, ticks = trajectory.episode.prior.path, trajectory.episode.ticks
    arrives = path.arrival is not None and path.arrival < ticks * trajectory.period
    measures = measure(trajectory.signals, trajectory.period, failure, path.arrival if arrives else None)
    return Result(trajectory.scenario, trajectory.policy, trajectory.seed, measures, failure, trajectory.drawn)


def _check_memory(env: SFFRFlexEnv, ticks: int, stride: int) -> None:
    """Raise ConfigError if the record of so many control periods is too large, ValueError for an impossible stride."""
    if isinstance(stride, bool) or not isinstance(stride, int | np.integer) or stride < 1:
        raise ValueError(f"stride must be a whole number of control periods, at least 1, got {stride!r}")
    stride = min(int(stride), ticks)
    row = make_record(env.plant_task, stride, stride)
    needed = ticks / stride * sum(np.asarray(array).nbytes for array in row) / 2**30
    if needed > LARGEST_RECORD:
        raise ConfigError(
            f"{env.scenario.name}: duration: an episode of {ticks * env.plant_task.period:.3g} s, {ticks:.1g} control "
            f"periods, would take {needed:.3g} GiB of memory, at most {LARGEST_RECORD:g}: give the scenario a shorter "
            "duration, or lengthen control.period"
        )


def _run_compiled(
    env: SFFRFlexEnv, policy: LawPolicy, obs: Array, ticks: int, record: Record, progress: Progress
) -> tuple[int, str]:
    """Run the compiled closed loop, in pieces so that progress can be shown."""
    if policy.law.at != env.prior_task.at or len(policy.law.scale) != len(env.prior_task.scale):
        raise ValueError(f"{policy.name} was made for a robot with other observations or actuators than this one's")
    p, v, obs = env.positions, env.velocities, obs.astype(np.float64)
    states, episode, actuation = make_states(policy.law, 1), env.episode, np.zeros(state_size(len(policy.law.scale)))
    work, outcome = new_workspace(loop_shapes(env.plant_task, policy.law)), np.array([0.0, RUNNING])
    done = 0
    while done < ticks and outcome[1] == RUNNING:
        run(
            env.plant_task, episode.reference, episode.sensing, episode.impulses, policy.law, work, done,
            min(done + PIECE, ticks), p, v, actuation, obs, states, record, outcome,
        )  # fmt: skip
        progress(int(outcome[0]) - done)
        done = int(outcome[0])
    return done, REASONS[float(outcome[1])]

"""Episodes: a policy in an environment from start to end, with everything that measures and pictures need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.closed_loop import Record, run
from baselines.policies import LawPolicy, OraclePolicy, Policy
from sffr_gym.beam import Array
from sffr_gym.env import SFFRFlexEnv
from sffr_gym.episode import Episode
from sffr_gym.geometry import tip_deflections
from sffr_gym.model import n_positions
from sffr_gym.observation import Field
from sffr_gym.reference import Reference
from sffr_gym.task import N_SIGNALS, REASONS, RUNNING, SIGNALS, make_buffers, make_robot, view

STRIDE = 25  # control periods between recorded states: 50 ms at the default period
PIECE = 2000  # control periods between two reports of progress

Progress = Callable[[int], Any]


@dataclass(frozen=True)
class Trajectory:
    """One episode.

    Attributes:
        policy, scenario: names; seed: of the episode.
        period: control period [s].
        signals: (n_ticks, N_SIGNALS) see ``task.SIGNALS``.
        tips: (n_ticks, n_p) each panel's transverse tip displacement at the periods' ends [m].
        t: (rows,) times of the recorded states [s].
        p, v, obs, applied, B_hat, q_flex, lam: (rows, ...) see :class:`closed_loop.Record`.
        episode: what the scenario drew: plant, reference and all the rest.
        fields: layout of the observation.
        failure: why it ended early; empty if it did not.
    """

    policy: str
    scenario: str
    seed: int
    period: float
    signals: Array
    tips: Array
    t: Array
    p: Array
    v: Array
    obs: Array
    applied: Array
    B_hat: Array
    q_flex: Array
    lam: Array
    episode: Episode
    fields: dict[str, Field]
    failure: str

    @property
    def reference(self) -> Reference:
        """The desired motion."""
        return self.episode.reference

    @property
    def drawn(self) -> dict[str, float]:
        """The values that the scenario drew."""
        return self.episode.drawn


def rollout(env: SFFRFlexEnv, policy: Policy, seed: int, progress: Progress | None = None) -> Trajectory:
    """Run one episode: in the compiled loop if the policy is one of the paper's laws, else through the interface.

    Args:
        env: the bare environment.
        policy: any policy.
        seed: of the episode; the same seed gives the same episode to every policy.
        progress: called with the number of control periods done since its last call.
    """
    obs, _ = env.reset(seed=seed)
    policy.reset(seed=seed)
    if isinstance(policy, OraclePolicy):
        policy.know(env.plant)
    ticks = env.ticks
    record = _make_record(env, ticks)
    report = progress or (lambda _: None)
    if isinstance(policy, LawPolicy):
        done, failure = _run_compiled(env, policy, obs, ticks, record, report)
    else:
        done, failure = _run_stepwise(env, policy, obs, ticks, record, report)
    rows = (done - 1) // STRIDE + 1
    kept = {name: getattr(record, name)[:rows] for name in Record._fields[3:]}
    return Trajectory(
        policy=policy.name, scenario=env.scenario.name, seed=seed, period=env.robot.period,
        signals=record.signals[:done], tips=record.tips[:done],
        t=np.linspace(0.0, (rows - 1) * STRIDE * env.robot.period, rows), **kept,
        episode=env.episode, fields=env.fields, failure=failure,
    )  # fmt: skip


def true_observations(trajectory: Trajectory) -> Array:
    """What a policy would have seen at the recorded times (rows, n_o) without noise and delay."""
    robot = make_robot(trajectory.episode.plant)
    buffers, signals, obs = make_buffers(robot), np.zeros(N_SIGNALS), np.zeros_like(trajectory.obs)
    for row, t in enumerate(trajectory.t):
        view(robot, trajectory.reference, t, trajectory.p[row], trajectory.v[row], buffers, obs[row], signals)
    return obs


def _run_compiled(
    env: SFFRFlexEnv, policy: LawPolicy, obs: Array, ticks: int, record: Record, progress: Progress
) -> tuple[int, str]:
    """The compiled closed loop, in pieces so that progress can be shown."""
    p, v, obs, B_hat, episode = env.positions, env.velocities, obs.copy(), policy.initial_damping(), env.episode
    factor = np.ones_like(B_hat)
    buffers = make_buffers(env.robot)
    done, outcome = 0, RUNNING
    while done < ticks and outcome == RUNNING:
        end = min(done + PIECE, ticks)
        reached, outcome = run(
            env.robot, episode.reference, episode.sensing, episode.impulses, policy.law, buffers, done, end, p, v, obs,
            B_hat, factor, record,
        )  # fmt: skip
        progress(reached - done)
        done = reached
    return done, REASONS[outcome]


def _run_stepwise(
    env: SFFRFlexEnv, policy: Policy, obs: Array, ticks: int, record: Record, progress: Progress
) -> tuple[int, str]:
    """Step after step through the Gymnasium interface, for any policy."""
    for tick in range(ticks):
        row, keep = tick // STRIDE, tick % STRIDE == 0
        if keep:
            record.p[row], record.v[row], record.obs[row] = env.positions, env.velocities, obs
            record.B_hat[row] = np.nan  # not a law with a virtual damping
        obs, _, terminated, _, info = env.step(policy(obs))
        record.signals[tick] = [info[name] for name in SIGNALS]
        record.tips[tick] = tip_deflections(env.robot.model, env.positions[None])[0]
        if keep:
            record.applied[row] = info["applied"]
            record.q_flex[row] = np.nan
            record.lam[row] = np.nan
        if (tick + 1) % PIECE == 0:
            progress(PIECE)
        if terminated:
            return tick + 1, info["failure"]
    return ticks, ""


def _make_record(env: SFFRFlexEnv, ticks: int) -> Record:
    """Allocate what an episode leaves."""
    robot, rows = env.robot, (ticks - 1) // STRIDE + 1
    n, n_p = n_positions(robot.model), len(robot.model.panel_root)
    return Record(
        signals=np.zeros((ticks, N_SIGNALS)), tips=np.zeros((ticks, n_p)), stride=STRIDE, p=np.zeros((rows, n)),
        v=np.zeros((rows, n)), obs=np.zeros((rows, len(robot.bound))), applied=np.zeros((rows, len(robot.scale))),
        B_hat=np.zeros((rows, n_p, 3)), q_flex=np.zeros((rows, 3)), lam=np.zeros((rows, len(robot.model.grasp_arm), 2)),
    )  # fmt: skip

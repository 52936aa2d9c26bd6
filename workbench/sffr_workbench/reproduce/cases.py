"""The runs behind figures and claims: the paper's full law, around the circle, from several starts and gains."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sffr_baselines import make_policy
from sffr_baselines.rollout import Trajectory, rollout
from sffr_baselines.suppression import Suppression, make_suppression
from sffr_gym.config.params import Params, load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.model import Model, joint_slice, pack
from sffr_gym.task.metrics import measure
from sffr_gym.task.observation import held_joints
from sffr_gym.task.scenario import load_scenario
from sffr_gym.types import Array
from sffr_workbench.common import Progress, ignore

FULL_LAW = ("control.period=5.0e-4", "suppression.coordinates=all")  # the paper's three coordinates, stably sampled
NO_PANELS = "panel.mounts=[]"
STARTS = (1.0, 0.1, 0.01)  # times B(0) of Table IV
GAINS = (1.0, 10.0, 100.0)  # times Gamma of Table IV
ADAPTIVE = ("ahsc", "ahsc-filtered")
SEED = 0  # the nominal scenario draws nothing


class Case(NamedTuple):
    """A policy with its virtual damping at the start and its adaptation gains, as factors of Table IV."""

    policy: str
    start: float = 1.0
    gain: float = 1.0


@dataclass(frozen=True)
class CaseRuns:
    """Everything that was run."""

    params: Params  #: the robot and the full law
    trajectories: Mapping[Case, Trajectory]  #: of the cases with the gains of Table IV
    measures: Mapping[Case, Mapping[str, float]]  #: of every case, see ``metrics.MEASURES``
    bare: Trajectory  #: the robot without panels
    elapsed: float  #: what the run of AHSC took on one core [s]

    @property
    def model(self) -> Model:
        """Return the robot as arrays."""
        return pack(self.params)

    def table_iv(self, *policies: str) -> dict[str, Trajectory]:
        """Return trajectories from the start of Table IV by policy."""
        return {policy: self.trajectories[Case(policy)] for policy in policies}


class TaskErrors(NamedTuple):
    """Errors of a group of task coordinates, desired minus actual."""

    name: str  #: of the group
    unit: str  #: of its errors
    labels: tuple[str, ...]  #: (k,) of its coordinates
    errors: Array  #: (rows, k)
    rates: Array  #: (rows, k)


def cases() -> list[Case]:
    """Return all cases, the one without suppression first."""
    adaptive = [Case(policy, start, gain) for gain in GAINS for start in STARTS for policy in ADAPTIVE]
    return [Case("none"), *(Case("hsc", start) for start in STARTS), *adaptive]


def run_cases(duration: float | None = None, progress: Progress = ignore) -> CaseRuns:
    """Run all cases.

    Args:
        duration: of each run [s]; None for once around the circle.
        progress: called with what runs.
    """
    params = load_params().with_overrides(*FULL_LAW)
    env, listed = _environment(params, duration), cases()
    progress("the robot without panels", 0, len(listed) + 1)
    bare_params = params.with_overrides(NO_PANELS)
    bare = rollout(_environment(bare_params, duration), make_policy("none", bare_params), SEED)
    trajectories, measures, elapsed = {}, {}, 0.0
    for done, case in enumerate(listed):
        progress(describe(case), done + 1, len(listed) + 1)
        policy, begun = make_policy(case.policy, with_law(params, case)), time.perf_counter()
        trajectory = rollout(env, policy, SEED)
        if case == Case("ahsc"):
            elapsed = time.perf_counter() - begun
        measures[case] = measure(trajectory.signals, trajectory.period, trajectory.failure)
        if case.gain == 1.0:
            trajectories[case] = trajectory
    return CaseRuns(params, trajectories, measures, bare, elapsed)


def with_law(params: Params, case: Case) -> Params:
    """Return the parameters with a case's virtual damping at the start and gains."""
    law = params.suppression
    B0, Gamma = [case.start * value for value in law.B0], [case.gain * value for value in law.Gamma]
    return params.with_overrides(f"suppression.B0={B0}", f"suppression.Gamma={Gamma}")


def adaptation_law(params: Params, policy: str) -> Suppression:
    """Return the law of an adaptive policy."""
    return make_suppression(params, active=True, adaptive=True, filtered=policy == "ahsc-filtered")


def describe(case: Case) -> str:
    """Return a case in words, such as ``ahsc from B(0)/10 with 100 Gamma``; factors of 1 are left out."""
    start = "" if case.start == 1.0 else f" from B(0)/{1.0 / case.start:g}"
    return f"{case.policy}{start}" + ("" if case.gain == 1.0 else f" with {case.gain:g} Gamma")


def task_errors(trajectory: Trajectory, model: Model) -> list[TaskErrors]:
    """Return the nine task coordinates' errors and rates (Eq. 12), in four groups."""

    def field(name: str) -> Array:
        return trajectory.obs[:, trajectory.fields[name].slice]

    held = held_joints(model)
    n_l = joint_slice(model).stop - joint_slice(model).start
    rates = field("joint_rate")[:, np.arange(n_l)[held]]
    grippers = tuple(f"gripper {g + 1} {axis}" for g in range(len(model.grasp_arm)) for axis in "xy")
    return [
        TaskErrors("base position", "m", ("base x", "base y"), field("base_error"), field("base_error_rate")),
        TaskErrors("base yaw", "rad", ("base yaw",), field("yaw_error"), field("yaw_error_rate")),
        TaskErrors("grippers", "m", grippers, field("tip_error"), field("tip_error_rate")),
        TaskErrors("held joints", "rad", ("antenna", "camera"), field("hold_error"), -rates),
    ]


def _environment(params: Params, duration: float | None) -> SFFRFlexEnv:
    """Return the environment of the nominal scenario, its episodes cut to a duration."""
    return SFFRFlexEnv(scenario=load_scenario("nominal").model_copy(update={"duration": duration}), params=params)

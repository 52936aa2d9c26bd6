"""The runs behind figures and claims: the paper's full law, around the circle, from several starts and gains."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baselines import make_policy
from baselines.rollout import Trajectory, rollout
from baselines.suppression import Suppression, make_suppression
from sffr_gym.beam import Array
from sffr_gym.env import SFFRFlexEnv
from sffr_gym.metrics import measure
from sffr_gym.model import Model, joint_slice, pack
from sffr_gym.observation import held_joints
from sffr_gym.params import Params, load_params

FULL_LAW = ("control.period=5.0e-4", "suppression.coordinates=all")  # the paper's three coordinates, stably sampled
NO_PANELS = "panel.mounts=[]"
STARTS = (1.0, 0.1, 0.01)  # times B(0) of Table IV
GAINS = (1.0, 10.0, 100.0)  # times Gamma of Table IV
ADAPTIVE = ("ahsc", "ahsc-filtered")
SEED = 0  # the nominal scenario draws nothing

Report = Callable[[str, int, int], Any]  # what runs, how many steps are done, and of how many


class Case(NamedTuple):
    """A policy with its virtual damping at the start and its adaptation gains, as factors of Table IV."""

    policy: str
    start: float = 1.0
    gain: float = 1.0


@dataclass(frozen=True)
class Study:
    """Everything that was run.

    Attributes:
        params: the robot and the full law.
        trajectories: of the cases with the gains of Table IV.
        measures: of every case, see ``metrics.MEASURES``.
        bare: the robot without panels.
        elapsed: what the run of AHSC took on one core [s], compiled before.
    """

    params: Params
    trajectories: Mapping[Case, Trajectory]
    measures: Mapping[Case, Mapping[str, float]]
    bare: Trajectory
    elapsed: float

    @property
    def model(self) -> Model:
        """The robot as arrays."""
        return pack(self.params)

    def table_iv(self, *policies: str) -> dict[str, Trajectory]:
        """Trajectories from the start of Table IV by policy."""
        return {policy: self.trajectories[Case(policy)] for policy in policies}


class Workspace(NamedTuple):
    """Errors of a group of task coordinates, desired minus actual.

    Attributes:
        name: of the group; unit: of its errors; labels: (k,) of its coordinates.
        errors, rates: (rows, k).
    """

    name: str
    unit: str
    labels: tuple[str, ...]
    errors: Array
    rates: Array


def cases() -> list[Case]:
    """All cases, the one without suppression first."""
    adaptive = [Case(policy, start, gain) for gain in GAINS for start in STARTS for policy in ADAPTIVE]
    return [Case("none"), *(Case("hsc", start) for start in STARTS), *adaptive]


def run_study(duration: float | None = None, report: Report = lambda what, done, total: None) -> Study:
    """Run all cases.

    Args:
        duration: of each run [s]; None for once around the circle.
        report: told what runs.
    """
    params = load_params().with_overrides(*FULL_LAW)
    env, listed = _environment(params, duration), cases()
    report("the robot without panels", 0, len(listed) + 1)
    bare_params = params.with_overrides(NO_PANELS)
    bare = rollout(_environment(bare_params, duration), make_policy("none", bare_params), SEED)
    trajectories, measures, elapsed = {}, {}, 0.0
    for done, case in enumerate(listed):
        report(describe(case), done + 1, len(listed) + 1)
        policy, begun = make_policy(case.policy, with_law(params, case)), time.perf_counter()
        trajectory = rollout(env, policy, SEED)
        if case == Case("ahsc"):
            elapsed = time.perf_counter() - begun
        measures[case] = measure(trajectory.signals, trajectory.period, trajectory.failure)
        if case.gain == 1.0:
            trajectories[case] = trajectory
    return Study(params, trajectories, measures, bare, elapsed)


def with_law(params: Params, case: Case) -> Params:
    """The parameters with a case's virtual damping at the start and gains."""
    law = params.suppression
    B0, Gamma = [case.start * value for value in law.B0], [case.gain * value for value in law.Gamma]
    return params.with_overrides(f"suppression.B0={B0}", f"suppression.Gamma={Gamma}")


def adaptation_law(params: Params, policy: str) -> Suppression:
    """The law of an adaptive policy."""
    return make_suppression(params, active=True, adaptive=True, filtered=policy == "ahsc-filtered")


def describe(case: Case) -> str:
    """A case in words, such as ``ahsc from B(0)/10 with 100 Gamma``; factors of 1 are left out."""
    start = "" if case.start == 1.0 else f" from B(0)/{1.0 / case.start:g}"
    return f"{case.policy}{start}" + ("" if case.gain == 1.0 else f" with {case.gain:g} Gamma")


def workspace(trajectory: Trajectory, model: Model) -> list[Workspace]:
    """The nine task coordinates' errors and rates (Eq. 12), in four groups."""

    def field(name: str) -> Array:
        values: Array = trajectory.obs[:, trajectory.fields[name].slice]
        return values

    held = held_joints(model)
    n_l = joint_slice(model).stop - joint_slice(model).start
    rates = field("joint_rate")[:, np.arange(n_l)[held]]
    grippers = tuple(f"gripper {g + 1} {axis}" for g in range(len(model.grasp_arm)) for axis in "xy")
    return [
        Workspace("base position", "m", ("base x", "base y"), field("base_error"), field("base_error_rate")),
        Workspace("base yaw", "rad", ("base yaw",), field("yaw_error"), field("yaw_error_rate")),
        Workspace("grippers", "m", grippers, field("tip_error"), field("tip_error_rate")),
        Workspace("held joints", "rad", ("antenna", "camera"), field("hold_error"), -rates),
    ]


def _environment(params: Params, duration: float | None) -> SFFRFlexEnv:
    env = SFFRFlexEnv(scenario="nominal", params=params)
    env.scenario = env.scenario.model_copy(update={"duration": duration})
    return env

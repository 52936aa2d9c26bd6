"""Figures of learning: curves over training seeds, and what a schedule does with the panels' phase."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sffr_agents.folder import PROGRESS, SECONDS, STEPS, read_run
from sffr_agents.progress import read_progress
from sffr_baselines import make_policy
from sffr_baselines.learned import LearnedSchedule
from sffr_baselines.rollout import Trajectory, rollout
from sffr_baselines.schedule import FEATURES
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.scenario import EVALUATION_SEED
from sffr_gym.task.score import REFERENCE
from sffr_gym.task.signals import VIBRATION
from sffr_gym.task.statistics import interquartile_mean
from sffr_gym.types import Array
from sffr_workbench.figures.style import OTHER_COLOURS, POLICY_COLOURS, canvas, legend, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SCORE = "score/{}/vibration"
TIPS = (0.25, 0.1, 0.03, 0.01)  # m, swings that are shown
SHADES = ("#440154", "#31688E", "#35B779", "#B5A800")  # of them
PHASES, PLACES = 121, 24  # of the swing, and around the circle
SHOWN = 40.0  # s of the episode
TOP = 1.1  # of the learning curves, in units of AHSC's vibration
LABELS = {"feedback": "feedback", "reaction": "panel's reaction"}  # of decisions that are none about a damping
STRIDE = 25  # control periods between two points of the episode


class Curve(NamedTuple):
    """One training's comparisons with AHSC."""

    algo: str  #: of the training
    seed: int
    steps: Array  #: (n,) when
    seconds: Array  #: (n,)
    vibration: dict[str, Array]  #: (n,) ratio to AHSC's of each scenario


def read_curve(folder: Path) -> Curve:
    """Read a run's comparisons with AHSC.

    Raises:
        ConfigError: if it holds none, or a damaged file.
    """
    config, seed = read_run(folder)
    file = folder / PROGRESS
    names = config.validation.scenarios
    lines = enumerate(read_progress(file) if file.exists() else [], 2)
    rows = {number: row for number, row in lines if row.get(SCORE.format(names[0]))}
    if not rows:
        raise ConfigError(f"{folder}: has not been compared with {REFERENCE} yet")
    columns = {
        key: np.array([_number(row, key, f"{file}:{number}") for number, row in rows.items()])
        for key in (STEPS, SECONDS, *map(SCORE.format, names))
    }
    return Curve(
        config.algo, seed, columns[STEPS], columns[SECONDS], {name: columns[SCORE.format(name)] for name in names}
    )


def by_algorithm(curves: Sequence[Curve]) -> dict[str, list[Curve]]:
    """Group curves by algorithm, cut to the comparisons that all of its trainings made.

    Raises:
        ConfigError: if a training is given twice, or trainings of an algorithm compared at other steps or scenarios.
    """
    groups: dict[str, list[Curve]] = {}
    for curve in curves:
        own = groups.setdefault(curve.algo, [])
        if any(curve.seed == other.seed for other in own):
            raise ConfigError(f"{curve.algo}: seed {curve.seed} is given twice")
        own.append(curve)
    for algo, own in groups.items():
        count = min(len(curve.steps) for curve in own)
        own[:] = [_cut(curve, count) for curve in own]
        if any((each.steps != own[0].steps).any() or each.vibration.keys() != own[0].vibration.keys() for each in own):
            raise ConfigError(f"{algo}: the trainings were compared with {REFERENCE} at other steps or scenarios")
    return groups


def learning_curves(groups: dict[str, list[Curve]]) -> Figure:
    """Draw vibration relative to AHSC's against steps and minutes: every seed, and the interquartile mean."""
    scenarios = list(next(iter(groups.values()))[0].vibration)
    figure, grid = canvas(len(scenarios), 2, 2.9 * len(scenarios), sharey="row", sharex="col")
    for row, scenario in zip(grid, scenarios, strict=True):
        for k, (algo, curves) in enumerate(groups.items()):
            values = np.array([curve.vibration[scenario] for curve in curves])
            typical = interquartile_mean(values.T[:, :, None])
            minutes = np.mean([curve.seconds for curve in curves], axis=0) / 60.0
            for axes, x in zip(row, (curves[0].steps / 1.0e6, minutes), strict=True):
                axes.plot(x, values.T, color=OTHER_COLOURS[k], linewidth=0.6, alpha=0.5)
                axes.plot(x, typical, color=OTHER_COLOURS[k], linewidth=1.8, label=f"{plain(algo)} ({len(curves)})")
        for axes in row:
            axes.axhline(1.0, color=POLICY_COLOURS[REFERENCE], linewidth=1.0)
            axes.set_ylim(0.0, TOP)
        row[0].set_ylabel(f"{plain(scenario)}: vibration / AHSC's")
    grid[-1, 0].set_xlabel("million actions of single panels")
    grid[-1, 1].set_xlabel("minutes of training")
    grid[0, 0].legend(loc="lower left", title="algorithm (seeds)", alignment="left")
    return figure


def schedule_figure(schedule: LearnedSchedule, params: Params) -> Figure:
    """Draw the factor of the damping against the phase of a panel's first mode, and one episode beside AHSC's."""
    figure, grid = canvas(2, 2, 6.2)
    phase = np.linspace(0.0, 360.0, PHASES)
    for tip, shade in zip(TIPS, SHADES, strict=True):
        factors = schedule.rho ** _decisions(schedule, params, tip, np.radians(phase))
        low, middle, high = np.quantile(factors, [0.1, 0.5, 0.9], axis=0)
        for k, axes in enumerate(grid[0]):
            axes.fill_between(phase, low[:, k], high[:, k], color=shade, alpha=0.12, linewidth=0.0)
            axes.plot(phase, middle[:, k], color=shade, label=f"{100.0 * tip:g} cm")
    for axes, name in zip(grid[0], schedule.action_names[:2], strict=True):
        axes.set_yscale("log")
        axes.set_ylim(0.9 / schedule.rho, 1.1 * schedule.rho)
        axes.set_xlim(0.0, 360.0)
        axes.set_xticks(range(0, 361, 90))
        axes.set_xlabel("phase [°]: bent most at 0 and 180, fastest at 90 and 270")
        what = name.partition("_")[2]
        axes.set_ylabel(f"factor of the {LABELS.get(what, f'damping of {what}')}")
        axes.axhline(1.0, color=POLICY_COLOURS[REFERENCE], linewidth=1.0)
    _draw_episode(grid[1], schedule, params)
    return legend(figure, grid[0, 0], title="swing of the tip")


def _number(row: dict[str, str], key: str, where: str) -> float:
    """Return a number of a row; raises ConfigError if it is none, or steps or time are not finite."""
    try:
        value = float(row[key])
    except KeyError:
        raise ConfigError(f"{where}: has no column {key!r}") from None
    except ValueError:
        raise ConfigError(f"{where}: {key} = {row[key]!r}: must be a number") from None
    if key in (STEPS, SECONDS) and not isfinite(value):
        raise ConfigError(f"{where}: {key} = {row[key]!r}: must be finite")
    return value


def _cut(curve: Curve, count: int) -> Curve:
    """Return the first comparisons of a training."""
    vibration = {name: values[:count] for name, values in curve.vibration.items()}
    return curve._replace(steps=curve.steps[:count], seconds=curve.seconds[:count], vibration=vibration)


def _decisions(schedule: LearnedSchedule, params: Params, tip: float, phase: Array) -> Array:
    """Return decisions (places, phases, 2) for the left panel swinging in its first mode, on the path, others at rest.

    Args:
        schedule: the policy; what it remembers is the swing before.
        params: the robot that it believes in.
        tip: amplitude of the tip [m].
        phase: (n,) of the swing [rad].
    """
    law = schedule.policy(params).law.schedule
    amplitude = law.omega[0, 0] * tip / np.linalg.inv(law.modes[0])[0, 0]  # its square is twice the energy
    place = np.linspace(-0.5 * np.pi, 0.5 * np.pi, PLACES)[:, None]  # the others are mirror images
    names = [name for name, _ in FEATURES]
    seen = np.zeros((PLACES, len(phase), params.n_panels, schedule.stack_size, len(FEATURES)))
    for name, value in (("log_amplitude", -3.0), ("piezo_demand", -2.0), ("thruster_or_joint_demand", -2.0),
                        ("base_error", -3.0)):  # fmt: skip
        seen[..., names.index(name)] = value  # nothing, as a logarithm
    for age in range(schedule.stack_size):
        before = phase - law.omega[0, 0] * age * schedule.agent_period
        own = {
            "mode1_displacement": np.cos(before), "mode1_rate": -np.sin(before),
            "mode1_potential_less_kinetic": np.cos(2.0 * before), "mode1_displacement_by_rate": -np.sin(2.0 * before),
            "log_amplitude": 0.5 * np.log10(0.5 * amplitude**2 / law.energy),
            "acceleration": np.cos(place), "acceleration_rate": -np.sin(place),
        }  # fmt: skip
        for name, values in own.items():
            seen[:, :, 0, age, names.index(name)] = values
    return schedule.predict(seen.reshape(PLACES, len(phase), -1))[0][..., :2].astype(np.float64)


def _draw_episode(row: Sequence[Axes], schedule: LearnedSchedule, params: Params) -> None:
    """Draw vibration energy and damping over the first evaluation episode of ``excited``, beside AHSC's."""
    env = SFFRFlexEnv(scenario="excited", params=params)
    runs: dict[str, Trajectory] = {
        policy.name: rollout(env, policy, EVALUATION_SEED)
        for policy in (make_policy(REFERENCE, params), schedule.policy(params))
    }
    for name, run in runs.items():
        colour = POLICY_COLOURS.get(name, "#000000")
        energy = run.signals[::STRIDE, VIBRATION]
        row[0].plot(
            run.period * STRIDE * np.arange(len(energy)), 1.0e3 * energy, color=colour, label=plain(name), linewidth=1.0
        )
        row[1].plot(run.t, run.B_hat[:, 0, 1], color=colour, label=plain(name), linewidth=1.0)
    for axes in row:
        axes.set_xlim(0.0, SHOWN)
        axes.set_xlabel(f"time in the first evaluation episode of {env.scenario.name} [s]")
        axes.set_yscale("log")
    row[0].set_ylim(bottom=1.0e-3)
    row[0].set_ylabel("vibration energy [mJ]")
    row[1].set_ylabel("damping of the left panel's q5 [N s/m]")
    row[0].legend(loc="upper right")

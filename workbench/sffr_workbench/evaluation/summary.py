"""Summary of an evaluation for the terminal: the table of measures and scores, and what to know besides."""

from __future__ import annotations

from typing import NamedTuple

from rich.table import Table
from rich.text import Text

from sffr_baselines.laws import undamped_coordinates
from sffr_gym.task.metrics import ARRIVAL_MEASURES, MEASURES
from sffr_gym.task.score import REFERENCE, WEIGHTS, costs, ratios
from sffr_workbench.common import format_number, plural, prefixed_unit, terminal_table
from sffr_workbench.evaluation.run import Evaluation


class Column(NamedTuple):
    """A measure in tables."""

    measure: str  #: of ``MEASURES``
    title: str  #: its name on pages
    heading: str  #: in two lines, on the terminal
    always: bool = True  #: False: left out on a terminal of less than ``WIDE`` columns

    @property
    def unit(self) -> str:
        """The measure's unit."""
        return (MEASURES | ARRIVAL_MEASURES)[self.measure]


COLUMNS = (
    Column("track_rmse", "tracking, rms", "track\nrmse"),
    Column("track_max", "tracking, largest", "track\nmax"),
    Column("vibration", "vibration", "vibr.\nmean"),
    Column("tip_max", "largest tip", "tip\nmax"),
    Column("residual_tip", "tip after arrival", "tip\nafter"),
    Column("settling_time", "settled after", "settled\nafter"),
    Column("piezo_effort", "piezo effort", "piezo\neffort"),
    Column("thruster_impulse", "thrust impulse", "thrust\nimpulse", always=False),
)
WIDE = 96


def summary_table(evaluation: Evaluation, width: int = 100) -> Table:
    """Return the table for a terminal of ``width`` columns: a row for each policy, the means over the episodes."""
    means, results, reference = evaluation.summary()["policies"], evaluation.results, evaluation.reference
    failures = {policy: sum(bool(result.failure) for result in own) for policy, own in results.items()}
    whole = [policy for policy, failed in failures.items() if not failed] or list(results)
    episodes = plural(evaluation.episodes, "episode")
    title = f"{evaluation.scenario.name}: {episodes} {_span(evaluation)}, from seed {evaluation.seed}"
    out = terminal_table(title, padding=int(width >= WIDE))
    out.add_column("\n\npolicy", style="bold", no_wrap=True)
    columns: list[dict[str, str]] = []
    for column in COLUMNS:
        name, heading = column.measure, column.heading
        arrives, wide = "residual_tip" in means[reference], width >= WIDE
        if name == "settling_time" and arrives and not wide:  # for which there is no room then
            continue
        if name in means[reference] and (column.always or wide):
            unit, scale = prefixed_unit(column.unit, max(abs(means[policy][name]) for policy in whole))
            out.add_column(f"{heading}\n{unit}", justify="right", no_wrap=True)
            columns.append({policy: format_number(means[policy][name] / scale) for policy in results})
    for name, heading in ("vibration", "vibr.\nratio"), ("track_rmse", "track\nratio"):
        out.add_column(heading, justify="right", no_wrap=True)
        columns.append({policy: format_number(value) for policy, value in ratios(results, name, reference).items()})
    if REFERENCE in results:
        out.add_column("\ncost", justify="right", style="bold", no_wrap=True)
        columns.append({policy: format_number(value) for policy, value in costs(results).items()})
    out.add_column("\nfailed", justify="right", no_wrap=True)
    columns.append({policy: f"{failed}/{evaluation.episodes}" for policy, failed in failures.items()})
    for policy in results:
        out.add_row(Text(policy), *(cells[policy] for cells in columns), style="red" if failures[policy] else None)
    return out


def summary_remarks(evaluation: Evaluation) -> list[str]:
    """Return what a reader of the table has to know besides: failures, saturation, what the laws leave undamped."""
    lines = [f"skipped: {reason}" for reason in evaluation.skipped.values()]
    for policy, results in evaluation.results.items():
        reasons = [result.failure for result in results if result.failure]
        for reason in dict.fromkeys(reasons):
            lines.append(f"{policy} failed in {reasons.count(reason)} of {len(results)}: {reason}")
    if any(result.failure for result in evaluation.results.get(evaluation.reference, ())):
        lines.append(f"{evaluation.reference} itself failed, so that ratios to it say little")
    means = evaluation.summary()["policies"]
    for policy, values in means.items():
        busy = {group: values[f"{group}_saturation"] for group in ("piezo", "thruster", "joint")}
        parts = [
            f"{group} {format_number(100.0 * share)} % of the time" for group, share in busy.items() if share > 0.0
        ]
        if parts:
            lines.append(f"{policy} saturates: {', '.join(parts)}")
    if not any(values[name] for values in means.values() for name in values if name.endswith("_saturation")):
        lines.append("no actuator saturates")
    scored = ", ".join(f"{weight:.2f} {name}" for name, weight in WEIGHTS.items())
    cost = f"; cost = {scored}, lower is better" if evaluation.reference == REFERENCE else ""
    lines.append(f"ratios are to {evaluation.reference}{cost}")
    if evaluation.scenario.changes_model:
        lines.append("oracles know each episode's plant; the others take it for the robot of the parameters")
    if undamped := undamped_coordinates(evaluation.params):
        lines.append(f"hsc and ahsc leave {', '.join(undamped)} undamped at this control period")
    return lines


def _span(evaluation: Evaluation) -> str:
    """Return how long the episodes are, in words."""
    scenario, params = evaluation.scenario, evaluation.params
    if scenario.duration is None and scenario.speed is not None:
        return "once around"
    return f"of {scenario.ticks(params) * params.control.period:.4g} s"

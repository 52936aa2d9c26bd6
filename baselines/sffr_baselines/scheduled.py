"""A law whose virtual damping an agent schedules: what it may be, what the agent sees of it and what it changes."""

from __future__ import annotations

from itertools import product
from math import inf

import numpy as np

from sffr_baselines.closed_loop import Law
from sffr_baselines.laws import make_law
from sffr_baselines.schedule import FEATURES
from sffr_baselines.stability import MARGIN, sampled_growth
from sffr_baselines.suppression import COORDINATES
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError

LAWS = ("hsc", "ahsc")
RHO, AGENT_PERIOD = 10.0, 0.1  # largest factor of the damping [-], time between two actions [s]


def scheduled_law(prior: Params, name: str, rho: float, agent_period: float, base_tolerance: float | None) -> Law:
    """Return the law whose damping an agent schedules.

    Args:
        prior: what the controller believes of the robot.
        name: one of ``LAWS``.
        rho: largest factor of the damping; 1 / rho is the smallest.
        agent_period: time between two actions [s], a multiple of the control period.
        base_tolerance: error of the base [m] at which an action counts half; None: actions always count in full.

    Raises:
        ConfigError: for an unknown law, a robot without panels, a factor below 1, a period between actions that is no
            multiple of the control period, a tolerance that is not positive, or a damping within reach of the agent
            that the sampled loop cannot run.
    """
    if name not in LAWS:
        raise ConfigError(f"law = {name!r}: must be one of {', '.join(LAWS)}")
    if prior.n_panels == 0:
        raise ConfigError("the robot has no panels whose damping could be scheduled")
    if not rho >= 1.0:
        raise ConfigError(f"rho = {rho}: must be at least 1")
    if base_tolerance is not None and not base_tolerance > 0.0:
        raise ConfigError(f"base_tolerance = {base_tolerance}: must be positive, or None")
    period = prior.control.period
    hold = round(agent_period / period)
    if hold < 1 or abs(hold * period - agent_period) > 1e-9:
        raise ConfigError(f"agent_period = {agent_period}: must be a multiple of control.period = {period} [s]")
    law = make_law(name, prior)
    check_stability(law, rho)
    tolerance = inf if base_tolerance is None else float(base_tolerance)
    return law._replace(schedule=law.schedule._replace(hold=hold, rho=float(rho), tolerance=tolerance))


def check_stability(law: Law, rho: float) -> None:
    """Reject factors with which the damping, held over a control period, is unstable on the panels of the prior.

    Raises:
        ConfigError: with the largest growth found among the combinations of factors 1/rho, 1 and rho.
    """
    suppression = law.suppression
    factors = np.array(list(product((1.0 / rho, 1.0, rho), repeat=len(suppression.B0))))
    growth = sampled_growth(law.prior, factors * suppression.B0, suppression.damped, suppression.period)
    if growth.max() > 1.0 + MARGIN:
        worst = (factors * suppression.B0 * suppression.damped)[growth.argmax()].tolist()
        raise ConfigError(
            f"rho = {rho:g}: with the virtual damping {worst}, held for {suppression.period:g} s, a panel's vibration "
            f"grows {growth.max():.3g} times each period; lower rho, shorten control.period, or leave out fast modes "
            "with panel.bending_cut"
        )


def observation_names(prior: Params) -> tuple[str, ...]:
    """Return the names of what the agent sees, in order."""
    return tuple(f"{mount.name}_{name}" for mount in prior.panel.mounts for name, _ in FEATURES)


def action_names(prior: Params, law: Law) -> tuple[str, ...]:
    """Return the names of what the agent changes, in order: panel and coordinate of each damping that it multiplies."""
    damped = [name for name, on in zip(COORDINATES, law.suppression.damped, strict=True) if on]
    return tuple(f"{mount.name}_{name}" for mount in prior.panel.mounts for name in damped)

"""A law whose damping an agent schedules: what it may be, what the agent sees of it and what it changes."""

from __future__ import annotations

from itertools import product
from math import inf
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from sffr_baselines.control_law import Law
from sffr_baselines.laws import make_law
from sffr_baselines.panel_reaction import N_BENDING
from sffr_baselines.schedule import FEATURES, decisions_of_panel
from sffr_baselines.stability import MARGIN, feedback_growth, sampled_growth
from sffr_baselines.suppression import COORDINATES
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.params import Params
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import ConfigError, check_error
from sffr_gym.config.suggestion import did_you_mean
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.beam import N_TIP
from sffr_gym.types import Array

RHO, AGENT_PERIOD = 10.0, 0.1  # largest factor of the damping [-], time between two actions [s]
# Laws that damp the panels, or feed their state back. Not `none`, which does neither, nor `ppf`, whose filters push
# with the panels' own stiffness: more than all of it is unstable.
SCHEDULED = ("hsc", "ahsc", "ahsc-filtered", "hsc-tuned", "ahsc-ff", "lqr", "lqr-ff", "lqr-kf", "mpc")

MOST_STACKED = 100  # ten seconds, a swing of a panel
LEVELS = 21  # of a regulator's factor at which its stability is looked at


def _check_law(name: str) -> str:
    """Reject a law that cannot be scheduled."""
    if name not in SCHEDULED:
        raise check_error(f"must be one of {', '.join(SCHEDULED)}{did_you_mean(name, SCHEDULED)}")
    return name


class Scheduling(Section):
    """What an agent may do with the damping of a law.

    Three decades of damping either way leave nothing of it or lock a panel; a swing of a panel takes ten seconds.
    """

    law: Annotated[str, AfterValidator(_check_law)] = Field(default="ahsc", description="law that runs inside")
    rho: float = Field(default=RHO, ge=1.0, le=1000.0, description="largest factor of the damping [-]")
    agent_period: float = Field(default=AGENT_PERIOD, ge=1.0e-6, le=10.0, description="time between two actions [s]")
    base_tolerance: float | None = Field(
        default=None, ge=1.0e-9, le=1000.0,
        description="error of the base at which an action counts half [m]; null: it never does",
    )  # fmt: skip
    stack_size: int = Field(
        default=1, ge=1, le=MOST_STACKED, description="actions whose observations are seen at once, the newest first"
    )


def scheduled_law(
    prior: Params, name: str, rho: float, agent_period: float, base_tolerance: float | None, stack_size: int = 1
) -> Law:
    """Return the law whose damping an agent schedules.

    Args:
        prior: what the controller believes of the robot.
        name: one of ``SCHEDULED``.
        rho: largest factor of the damping; 1 / rho is the smallest.
        agent_period: time between two actions [s], a multiple of the control period.
        base_tolerance: error of the base [m] at which an action counts half; None: actions always count in full.
        stack_size: actions whose observations are seen at once.

    Raises:
        ConfigError: for an unknown law, a number out of its range, a robot without panels, a period between actions
            that is no multiple of the control period, or a damping within reach of the agent that the sampled loop
            cannot run.
    """
    check_arguments(
        Scheduling, law=name, rho=rho, agent_period=agent_period, base_tolerance=base_tolerance, stack_size=stack_size
    )
    if prior.n_panels == 0:
        raise ConfigError("panel.mounts: the robot has no panels whose damping could be scheduled")
    period = prior.control.period
    hold = round(agent_period / period)
    if hold < 1 or abs(hold * period - agent_period) > 1e-9:
        raise ConfigError(f"agent_period = {agent_period}: must be a multiple of control.period = {period} [s]")
    law = make_law(name, prior)
    check_stability(law, prior, rho)
    tolerance = inf if base_tolerance is None else float(base_tolerance)
    schedule = law.schedule._replace(hold=hold, stack=int(stack_size), rho=float(rho), tolerance=tolerance)
    return law._replace(schedule=schedule)


def check_stability(law: Law, prior: Params, rho: float) -> None:
    """Reject factors with which the damping or feedback, held over a control period, is unstable on the prior's panels.

    Raises:
        ConfigError: with the largest growth found among the combinations of factors 1/rho, 1 and rho.
    """
    suppression = law.suppression
    if law.regulator.active:
        growth = regulated_growth(law, prior, np.geomspace(1.0 / rho, rho, LEVELS))
        if growth.max() > 1.0 + MARGIN:
            raise ConfigError(
                f"rho = {rho:g}: with up to {rho:g} times the regulator's gain, or less of it, held for "
                f"{prior.control.period:g} s, a panel's vibration grows {growth.max():.3g} times each period; lower "
                "rho, or shorten control.period"
            )
        return
    factors = np.array(list(product((1.0 / rho, 1.0, rho), repeat=len(suppression.B0))))
    growth = sampled_growth(law.prior, factors * suppression.B0, suppression.damped, suppression.period)
    if growth.max() > 1.0 + MARGIN:
        worst = (factors * suppression.B0 * suppression.damped)[growth.argmax()].tolist()
        raise ConfigError(
            f"rho = {rho:g}: with the virtual damping {worst}, held for {suppression.period:g} s, a panel's vibration "
            f"grows {growth.max():.3g} times each period; lower rho, shorten control.period, or leave out fast modes "
            "with panel.bending_cut"
        )


def regulated_growth(law: Law, prior: Params, factors: Array) -> Array:
    """Return the growth of each panel (n_p, k) per control period with so many times its regulator's gain.

    Args:
        law: with a regulator.
        prior: what it believes.
        factors: (k,) of the gain.
    """
    K_PZ = pack_actuators(prior, law.prior).K_PZ
    growth = []
    for i, (force, gain) in enumerate(zip(K_PZ, law.regulator.gain, strict=True)):
        tip_force = (force @ gain).reshape(N_TIP, 2, N_BENDING)  # for a unit deviation of q5, q6, and of their rates
        stiffness, damping = np.zeros((2, len(factors), N_TIP, N_TIP))
        stiffness[..., 1:] = tip_force[:, 0] * factors[:, None, None]
        damping[..., 1:] = tip_force[:, 1] * factors[:, None, None]
        growth.append(feedback_growth(law.prior, i, stiffness, damping, prior.control.period))
    return np.array(growth)


def observation_names(prior: Params, stack_size: int) -> tuple[str, ...]:
    """Return the names of what the agent sees, in order; with ``_1`` what it saw an action ago, and so on."""
    ages = ["", *(f"_{k}" for k in range(1, stack_size))]
    return tuple(f"{mount.name}_{name}{age}" for mount in prior.panel.mounts for age in ages for name, _ in FEATURES)


def action_names(prior: Params, law: Law) -> tuple[str, ...]:
    """Return the names of what the agent changes, in order.

    Panel and coordinate of each damping that it multiplies, or a panel and ``feedback``; then a panel and ``reaction``,
    where the law feeds that forward.
    """
    damped = [name for name, on in zip(COORDINATES, law.suppression.damped, strict=True) if on]
    names = ["feedback"] if law.regulator.active else damped
    names += ["reaction"] if law.reaction.active else []
    assert len(names) == decisions_of_panel(law)
    return tuple(f"{mount.name}_{name}" for mount in prior.panel.mounts for name in names)

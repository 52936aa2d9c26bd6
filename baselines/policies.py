"""Policies by name, from ``none`` to ``lqr``; :data:`POLICIES` says what each is. They act on the observation alone."""

from __future__ import annotations

import difflib
import warnings
from typing import Any, Protocol

import numpy as np

from baselines.closed_loop import Law, act
from baselines.mic import layout
from baselines.regulator import make_regulator
from baselines.schedule import make_schedule
from baselines.settings import load_damping, load_weights
from baselines.stability import MARGIN, sampled_growth
from baselines.suppression import damped_coordinates, make_suppression
from sffr_gym.actuators import pack_actuators
from sffr_gym.beam import N_TIP, Array
from sffr_gym.initial import initial_positions
from sffr_gym.model import pack
from sffr_gym.observation import held_joints, observation_fields
from sffr_gym.params import Params
from sffr_gym.reference import circle_reference


class Policy(Protocol):
    """Anything that turns observations into actions.

    Attributes:
        name: what tables call it.
    """

    name: str

    def reset(self, seed: int | None = None) -> None:
        """Forget the last episode; ``seed`` fixes what the policy itself draws."""

    def __call__(self, obs: Array) -> Array:
        """Actions (n_u,) for an observation (n_o,), or (n, n_u) for (n, n_o) of as many environments."""


class LawPolicy:
    """A controller of the paper or its kin: MIC for the rigid part, virtual damping or feedback for the panels.

    Args:
        name: what tables call it.
        law: its compiled form.

    Attributes:
        law: its compiled form, for the closed loop.
        B_hat: (n, n_p, 3) virtual damping of each environment; None before the first observation.
        factor: (n, n_p, 3) what a schedule makes of it; tick: control periods since the start.
    """

    def __init__(self, name: str, law: Law) -> None:
        self.name = name
        self.law = law
        self.B_hat: Array | None = None
        self.factor = np.ones(0)
        self.tick = 0

    def reset(self, seed: int | None = None) -> None:
        """Put the virtual damping back to its start."""
        self.B_hat, self.tick = None, 0

    def initial_damping(self) -> Array:
        """Virtual damping (n_p, 3) at the start of an episode."""
        law = self.law.suppression
        return np.tile(law.B0 * law.damped, (len(self.law.allocation), 1))

    def __call__(self, obs: Array) -> Array:
        """Actions for one observation or a batch of them; see :class:`Policy`.

        Raises:
            ValueError: if the number of environments changes without a reset.
        """
        rows = np.atleast_2d(np.asarray(obs, dtype=np.float64))
        if self.B_hat is None:
            self.B_hat = np.tile(self.initial_damping(), (len(rows), 1, 1))
            self.factor = np.ones_like(self.B_hat)
        if len(self.B_hat) != len(rows):
            raise ValueError(f"observations of {len(self.B_hat)} environments expected, got {len(rows)}; call reset")
        actions = np.empty((len(rows), len(self.law.scale)))
        act(self.law, self.tick, rows, self.B_hat, self.factor, actions)
        self.tick += 1
        return actions.reshape(*np.shape(obs)[:-1], -1)


class OraclePolicy(LawPolicy):
    """A law that is told each episode's plant: what it gives with the right model of the robot.

    Args:
        name: what tables call it.
        base: the policy whose law it is.
        prior: what stands for the plant until :meth:`know`; of the same layout.
    """

    def __init__(self, name: str, base: str, prior: Params) -> None:
        super().__init__(name, make_law(prior, **_LAWS[base]))
        self._base = base
        self._knows = False

    def reset(self, seed: int | None = None) -> None:
        """Forget the plant, and put the virtual damping back to its start."""
        super().reset(seed)
        self._knows = False

    def know(self, plant: Params) -> None:
        """Take an episode's plant, ``env.unwrapped.plant``, for the model; call it after each reset."""
        self.law = make_law(plant, **_LAWS[self._base])
        self._knows = True

    def __call__(self, obs: Array) -> Array:
        """Actions for one observation; see :class:`Policy`.

        Raises:
            ValueError: if nobody told the plant since the reset.
        """
        if not self._knows:
            raise ValueError(f"{self.name} has to be told the plant after each reset: policy.know(env.unwrapped.plant)")
        return super().__call__(obs)


class RandomPolicy:
    """Uniform actions over the whole range.

    Args:
        n_actions: length of an action.
    """

    name = "random"

    def __init__(self, n_actions: int) -> None:
        self._n_actions = n_actions
        self._rng = np.random.default_rng()

    def reset(self, seed: int | None = None) -> None:
        """Start a new stream of random numbers."""
        self._rng = np.random.default_rng(seed)

    def __call__(self, obs: Array) -> Array:
        """Draw actions; see :class:`Policy`."""
        return self._rng.uniform(-1.0, 1.0, (*np.shape(obs)[:-1], self._n_actions))


POLICIES = {
    "none": "piezos off, multiple impedance control alone",
    "random": "uniform actions",
    "hsc": "hybrid suppression control: constant virtual damping",
    "ahsc": "adaptive hybrid suppression control, the printed law (Y = e)",
    "ahsc-filtered": "the same with the filtered output (Y = e_dot + psi e)",
    "hsc-tuned": "HSC with the best constant damping that an optimiser found, see configs/policies",
    "lqr": "not of the paper: optimal active feedback of the panels about their quasi-static shape",
    "hsc-oracle": "HSC told each episode's plant, for what a right model gives",
    "ahsc-oracle": "AHSC told each episode's plant",
}
ORACLES = {"hsc": "hsc-oracle", "ahsc": "ahsc-oracle"}  # the same laws with the right model
_LAWS = {
    "none": {"active": False, "adaptive": False},
    "hsc": {"active": True, "adaptive": False},
    "ahsc": {"active": True, "adaptive": True},
    "ahsc-filtered": {"active": True, "adaptive": True, "filtered": True},
    "hsc-tuned": {"active": True, "adaptive": False},
    "lqr": {"active": True, "adaptive": False},
}


def make_policy(name: str, env: Any) -> Policy:
    """Build a policy by name for an environment, single or vector, or for ``Params``.

    Raises:
        ValueError: for an unknown name (with the nearest one).

    Warns:
        UserWarning: if the law's virtual damping is unstable at the control period; see :mod:`baselines.stability`.
    """
    if name not in POLICIES:
        near = difflib.get_close_matches(name, POLICIES, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"unknown policy {name!r}{hint} (known: {', '.join(POLICIES)})")
    prior: Params = env if isinstance(env, Params) else env.unwrapped.params
    if name == "random":
        return RandomPolicy(len(pack_actuators(prior, pack(prior)).limit))
    effort_weight = None
    if name == "hsc-tuned":
        prior = load_damping().applied_to(prior)
    elif name == "lqr":
        prior, effort_weight = prior.with_overrides("suppression.B0=[0, 0, 0]"), load_weights().effort
    if name in ORACLES.values():
        policy: LawPolicy = OraclePolicy(name, name.removesuffix("-oracle"), prior)
    else:
        policy = LawPolicy(name, make_law(prior, **_LAWS[name], effort_weight=effort_weight))
    _warn_of_unstable_sampling(policy, prior)
    return policy


def make_law(
    prior: Params, *, active: bool, adaptive: bool, filtered: bool = False, effort_weight: float | None = None
) -> Law:
    """Pack what the controller believes for the compiled loop.

    Args:
        prior: what the controller believes of the robot.
        active: see :func:`suppression.make_suppression`, as the next two.
        adaptive: of the virtual damping.
        filtered: output of the adaptation.
        effort_weight: see :func:`regulator.make_regulator`.
    """
    model = pack(prior)
    actuators = pack_actuators(prior, model)
    p, _ = initial_positions(prior, model)
    reference = circle_reference(prior, model, p)
    return Law(
        prior=model,
        reference=reference,
        held=held_joints(model),
        Kp=prior.control.Kp,
        Kd=prior.control.Kd,
        layout=layout(observation_fields(model, prior)),
        suppression=make_suppression(prior, active=active, adaptive=adaptive, filtered=filtered),
        regulator=make_regulator(prior, model, reference, effort_weight),
        schedule=make_schedule(prior),
        allocation=actuators.allocation,
        scale=actuators.limit,
    )


def _warn_of_unstable_sampling(policy: LawPolicy, prior: Params) -> None:
    """Say so if the virtual damping feeds a panel because it is held over each control period."""
    law = policy.law.suppression
    if not (law.damped.any() and prior.n_panels):
        return
    growth = float(sampled_growth(policy.law.prior, law.B0, law.damped, law.period))
    if growth > 1.0 + MARGIN:
        warnings.warn(
            f"{policy.name} tears the panels apart: held for {law.period:g} s, the virtual damping suppression.B0 = "
            f"{law.B0.tolist()} lets a clamped panel's vibration grow {growth:.3g} times each period; shorten "
            "control.period, lower suppression.B0, or leave out fast modes with panel.bending_cut and panel.axial_cut",
            stacklevel=3,
        )


def left_out(prior: Params) -> tuple[str, ...]:
    """Tip coordinates that the law leaves undamped at the chosen control period, for the user to know."""
    damped = damped_coordinates(prior)
    return tuple(name for name in ("q4", "q5", "q6")[:N_TIP] if name not in damped)

"""The baselines' laws: what a controller believes, packed for the compiled loop, and policies that run them."""

from __future__ import annotations

import numpy as np

from sffr_baselines.closed_loop import Law, act, act_shapes
from sffr_baselines.regulator import make_regulator
from sffr_baselines.schedule import make_schedule
from sffr_baselines.settings import load_regulator_weights, load_tuned_damping
from sffr_baselines.suppression import COORDINATES, damped_coordinates, make_suppression
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.params import Params
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.model import pack
from sffr_gym.task.observation import held_joints, observation_fields, observation_index
from sffr_gym.task.reference import circle_reference
from sffr_gym.types import Array

ORACLES = {"hsc": "hsc-oracle", "ahsc": "ahsc-oracle"}  # the same laws with the right model
SUPPRESSION = {  # the panels' part of each law, see suppression.make_suppression
    "none": {"active": False, "adaptive": False},
    "hsc": {"active": True, "adaptive": False},
    "ahsc": {"active": True, "adaptive": True},
    "ahsc-filtered": {"active": True, "adaptive": True, "filtered": True},
    "hsc-tuned": {"active": True, "adaptive": False},
    "lqr": {"active": True, "adaptive": False},
}


class LawPolicy:
    """A controller of the paper or its kin: MIC for the rigid part, virtual damping or feedback for the panels.

    Args:
        name: what tables call it.
        law: its compiled form.

    Attributes:
        law: its compiled form, for the closed loop.
        B_hat: (n, n_p, 3) virtual damping in each environment [N s/m, N s/m, N m s/rad]; None before the first
            observation.
        factor: (n, n_p, 3) by which a schedule multiplies it [-].
        tick: control periods since the start.
    """

    def __init__(self, name: str, law: Law) -> None:
        self.name = name
        self._set_law(law)
        self.B_hat: Array | None = None
        self.factor = np.ones(0)
        self.tick = 0

    def reset(self, seed: int | None = None) -> None:
        """Put the virtual damping back to its start."""
        self.B_hat, self.tick = None, 0

    def _set_law(self, law: Law) -> None:
        """Take a law, and memory for it."""
        self.law, self._work = law, new_workspace(act_shapes(law))

    def initial_damping(self) -> Array:
        """Return the virtual damping (n_p, 3) at the start of an episode [N s/m, N s/m, N m s/rad]."""
        law = self.law.suppression
        return np.tile(law.B0 * law.damped, (len(self.law.allocation), 1))

    def __call__(self, obs: Array) -> Array:
        """Return the actions for one observation or a batch of them; see :class:`policies.Policy`.

        Raises:
            ValueError: if the number of environments changes without a reset.
        """
        rows = np.atleast_2d(np.ascontiguousarray(obs, dtype=np.float64))
        if self.B_hat is None:
            self.B_hat = np.tile(self.initial_damping(), (len(rows), 1, 1))
            self.factor = np.ones_like(self.B_hat)
        if len(self.B_hat) != len(rows):
            raise ValueError(f"observations of {len(self.B_hat)} environments expected, got {len(rows)}; call reset")
        actions = np.empty((len(rows), len(self.law.scale)))
        act(self.law, np.array([self.tick]), rows, self.B_hat, self.factor, actions, self._work)
        self.tick += 1
        return actions.reshape(*np.shape(obs)[:-1], -1)


class OraclePolicy(LawPolicy):
    """A law that is told the plant of each episode: what it gives with the right model of the robot.

    Args:
        name: one of the values of ``ORACLES``.
        prior: stands for the plant until :meth:`set_plant`; of the same layout.
    """

    def __init__(self, name: str, prior: Params) -> None:
        self._base = name.removesuffix("-oracle")
        super().__init__(name, make_law(self._base, prior))
        self._has_plant = False

    def reset(self, seed: int | None = None) -> None:
        """Forget the plant, and put the virtual damping back to its start."""
        super().reset(seed)
        self._has_plant = False

    def set_plant(self, plant: Params) -> None:
        """Take the plant of an episode, ``env.unwrapped.plant``, for the model; call it after each reset."""
        self._set_law(make_law(self._base, plant))
        self._has_plant = True

    def __call__(self, obs: Array) -> Array:
        """Return the action (n_u,) for the observation (n_o,) of the one environment whose plant it was told.

        Raises:
            ValueError: if the plant was not set since the reset, or for observations of several environments.
        """
        if not self._has_plant:
            raise ValueError(f"{self.name} needs the plant after each reset: policy.set_plant(env.unwrapped.plant)")
        if np.size(obs) != np.shape(obs)[-1]:
            raise ValueError(f"{self.name} has the model of one plant, and got observations of shape {np.shape(obs)}")
        return super().__call__(obs)


def make_law(name: str, prior: Params) -> Law:
    """Pack a law with what its controller believes.

    Args:
        name: a key of ``SUPPRESSION``.
        prior: what the controller believes of the robot.
    """
    effort_weight = None
    if name == "hsc-tuned":
        prior = load_tuned_damping().applied_to(prior)
    elif name == "lqr":
        prior, effort_weight = prior.with_overrides("suppression.B0=[0, 0, 0]"), load_regulator_weights().effort
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
        at=observation_index(observation_fields(model, prior)),
        suppression=make_suppression(prior, **SUPPRESSION[name]),
        regulator=make_regulator(prior, model, reference, effort_weight),
        schedule=make_schedule(prior),
        allocation=actuators.allocation,
        scale=actuators.limit,
    )


def undamped_coordinates(prior: Params) -> tuple[str, ...]:
    """Return the tip coordinates that the laws leave undamped at the chosen control period."""
    return tuple(name for name in COORDINATES if name not in damped_coordinates(prior))

"""The baselines' laws: what a controller believes, packed for the compiled loop, and policies that run them."""

from __future__ import annotations

import numpy as np

from sffr_baselines.closed_loop import act
from sffr_baselines.control_law import Law, LawState, law_shapes, make_states
from sffr_baselines.mic import Gains
from sffr_baselines.observer import make_observer
from sffr_baselines.panel_reaction import make_panel_reaction
from sffr_baselines.position_feedback import make_position_feedback
from sffr_baselines.predictive import make_predictive, no_prediction
from sffr_baselines.regulator import make_regulator
from sffr_baselines.schedule import make_schedule
from sffr_baselines.settings import (
    TUNED,
    FilterSettings,
    RegulatorWeights,
    Settings,
    TunedDamping,
    load_settings,
)
from sffr_baselines.shaper import make_shaped_reference
from sffr_baselines.suppression import COORDINATES, damped_coordinates, make_suppression
from sffr_gym.compile.kernels import Call
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.notebook import Shown
from sffr_gym.config.params import Params
from sffr_gym.config.sections import Control, Observer
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.model import pack
from sffr_gym.task.observation import held_joints, observation_fields, observation_index
from sffr_gym.task.reference import path_reference
from sffr_gym.types import Array

ORACLES = {"hsc": "hsc-oracle", "ahsc": "ahsc-oracle"}  # the same laws with the right model
SUPPRESSION = {  # the panels' part of each law, see suppression.make_suppression
    "none": {"active": False, "adaptive": False},
    "hsc": {"active": True, "adaptive": False},
    "ahsc": {"active": True, "adaptive": True},
    "ahsc-filtered": {"active": True, "adaptive": True, "filtered": True},
    "hsc-tuned": {"active": True, "adaptive": False},
    "lqr": {"active": True, "adaptive": False, "damps": False},
    "mpc": {"active": True, "adaptive": False, "damps": False},
    "ppf": {"active": True, "adaptive": False, "damps": False},
}
TRACKING = ("mpc",)  # laws that track better than the paper's without an ending that says so, see tracking()
SHAPERS = {"shaped": "zvd", "shaped-zv": "zv"}  # laws that keep the panels calm by the path alone, piezos off
FEEDFORWARD, FILTERED = "-ff", "-kf"  # endings of laws that track better than the paper's, see tracking()
NOISE = Observer(  # of the scenario `noise`, and accelerations that let integral action and impulses through
    position=1.0e-4, angle=1.0e-4, velocity=5.0e-4, rate=5.0e-4, acceleration=0.3, angular_acceleration=0.3
)


class LawPolicy(Shown):
    """A controller of the paper or its kin: MIC for the rigid part, virtual damping or feedback for the panels.

    Args:
        name: what tables call it.
        law: its compiled form.

    Attributes:
        law: its compiled form, for the closed loop.
        states: (n, ...) what it remembers of each environment; None before the first observation.
    """

    def __init__(self, name: str, law: Law) -> None:
        self.name, self.law = name, law
        self.states: LawState | None = None
        self._call: Call | None = None

    def _told(self) -> dict[str, object]:
        observations, actions = self.law.at.end, len(self.law.scale)
        return {"name": self.name, "observations": observations, "actions": actions, "tick": self.tick}

    @property
    def B_hat(self) -> Array | None:
        """The virtual damping (n, n_p, 3) in each environment [N s/m, N s/m, N m s/rad]; None as ``states``."""
        return None if self.states is None else self.states.B_hat

    @property
    def tick(self) -> int:
        """Control periods since the start."""
        return 0 if self.states is None else int(self._tick[0])

    def reset(self, seed: int | None = None) -> None:
        """Put the virtual damping back to its start."""
        self.states = self._call = None

    def initial_damping(self) -> Array:
        """Return the virtual damping (n_p, 3) at the start of an episode [N s/m, N s/m, N m s/rad]."""
        return make_states(self.law, 1).B_hat[0]

    def __call__(self, obs: Array) -> Array:
        """Return the actions for one observation or a batch of them; see :class:`policies.Policy`.

        Raises:
            ValueError: for observations of another robot, or if the number of environments changes without a reset.
        """
        rows, size = np.atleast_2d(np.asarray(obs, dtype=np.float64)), self.law.at.end
        if rows.shape[1:] != (size,):
            raise ValueError(f"{self.name} expects observations of {size} numbers, got some of shape {np.shape(obs)}")
        if self._call is None or self.states is None:
            self._call = self._prepare(len(rows))
        if len(self._rows) != len(rows):
            raise ValueError(f"observations of {len(self._rows)} environments expected, got {len(rows)}; call reset")
        self._rows[:] = rows
        self._call()
        self._tick += 1
        return self._actions.reshape(*np.shape(obs)[:-1], -1).copy()

    def _prepare(self, n: int) -> Call:
        """Return the law's call for so many environments, at the start of their episodes."""
        law = self.law
        self.states = make_states(law, n)
        self._tick = np.zeros(1, dtype=np.int64)
        self._rows, self._actions = np.zeros((n, law.at.end)), np.zeros((n, len(law.scale)))
        memory = new_workspace(law_shapes(law))
        return act.bind(law, self._tick, self._rows, self.states, self._actions, memory)


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
        self.law, self._call = make_law(self._base, plant), None
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


def make_law(name: str, prior: Params, settings: Settings | None = None) -> Law:
    """Pack a law with what its controller believes.

    Args:
        name: a key of ``SUPPRESSION``, or one with ``-ff`` or ``-kf``; see :func:`tracking`.
        prior: what the controller believes of the robot.
        settings: of the law; None for the shipped ones, of laws that have some.
    """
    kind = "none" if name in SHAPERS else kind_of(name)
    if settings is None and kind in TUNED:
        settings = load_settings(kind)
    weights = settings if isinstance(settings, RegulatorWeights) else None
    if isinstance(settings, TunedDamping):
        prior = settings.applied_to(prior)
    if name in SHAPERS:
        control = tracking(prior.control, filters=False).model_copy(update={"shaper": SHAPERS[name]})
        prior = prior.model_copy(update={"control": control})
    elif kind != name or kind in TRACKING:
        prior = prior.model_copy(update={"control": tracking(prior.control, filters=name.endswith(FILTERED))})
    model = pack(prior)
    actuators = pack_actuators(prior, model)
    p, _ = initial_positions(prior, model)
    reference = path_reference(prior, model, p)
    at = observation_index(observation_fields(model, prior))
    K_PZ = actuators.K_PZ
    return Law(
        prior=model,
        reference=reference,
        shaped=make_shaped_reference(prior, model, reference),
        held=held_joints(model),
        gains=Gains(prior.control.Kp, prior.control.Kd, prior.control.Ki),
        at=at,
        suppression=make_suppression(prior, **SUPPRESSION[kind]),
        regulator=make_regulator(prior, model, reference, K_PZ, weights),
        predictive=make_predictive(prior, K_PZ, weights)
        if weights is not None and kind == "mpc"
        else no_prediction(len(K_PZ), K_PZ.shape[2]),
        filters=make_position_feedback(prior, K_PZ, settings if isinstance(settings, FilterSettings) else None),
        observer=make_observer(prior, model, reference, at),
        floating=prior.actuators.thrusters == "none",
        reaction=make_panel_reaction(prior, model, K_PZ),
        schedule=make_schedule(prior),
        allocation=actuators.allocation,
        scale=actuators.rated,
    )


def kind_of(name: str) -> str:
    """Return the key of ``SUPPRESSION`` of a law's name: what the panels' part of it is called."""
    return name.removesuffix(FEEDFORWARD).removesuffix(FILTERED)


def tracking(control: Control, *, filters: bool) -> Control:
    """Return control settings of a law that tracks better than the paper's.

    It adds the panels' predicted reaction, makes up for sensors that lag, and integrates errors: with ``Ki = Kp^2 / (4
    Kd)``, the largest gain with which the slow errors ``Kd ed + Kp e + Ki z = 0`` do not oscillate.

    Args:
        control: the settings otherwise.
        filters: also estimate the errors by a Kalman filter.
    """
    added = {"feedforward": True, "delay_compensation": True, "Ki": control.Kp**2 / (4.0 * control.Kd)}
    return control.model_copy(update=added | ({"observer": NOISE} if filters else {}))


def undamped_coordinates(prior: Params) -> tuple[str, ...]:
    """Return the tip coordinates that the laws leave undamped at the chosen control period."""
    return tuple(name for name in COORDINATES if name not in damped_coordinates(prior))

"""The plant for programs: states in, states out, in physical units and the paper's coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sffr_gym.config.notebook import Shown
from sffr_gym.config.params import Params, load_params
from sffr_gym.physics import monolithic
from sffr_gym.physics.actuators import generalized_forces, pack_actuators, saturate
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.dynamics import flexible_wrench
from sffr_gym.physics.each_panel import panel_beams
from sffr_gym.physics.energy import energy_of, momentum_of, natural_frequencies
from sffr_gym.physics.initial import held_positions, initial_positions
from sffr_gym.physics.integrator import INTEGRATORS
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.linearization import LinearModel, linear_model
from sffr_gym.physics.model import N_BASE, Model, joint_slice, modal, mode_slice, nodal, object_slice, pack
from sffr_gym.physics.plant import Plant
from sffr_gym.types import Array

SHORTEST_STEP = 1.0e-9  # s; what moves less far in it than a position is rounded
MOST_STEPS = 10**7  # integration steps of a call, some ten seconds of computing that nothing interrupts


@dataclass(frozen=True)
class State:
    """Where the robot is; SI units, frames and signs as in ``sffr_gym.physics.model``."""

    t: float  #: time [s]
    q: Array  #: (n,) base x, y, yaw and joint angles [m, rad]
    qd: Array  #: (n,) their rates [m/s, rad/s]
    qf: Array  #: (n_p, 3 elements) elastic coordinates of every node, tip last: axial, transverse, slope [m, m, rad]
    qfd: Array  #: (n_p, 3 elements) their rates [m/s, m/s, rad/s]
    obj: Array | None  #: (3,) the object's pose [m, m, rad]; None without an object
    objd: Array | None  #: (3,) its velocity [m/s, m/s, rad/s]; None without an object


class Applied(NamedTuple):
    """What the limits leave of a command, and which actuators they bound."""

    base: Array  #: (3,) thrust along the base axes [N, N, N m]
    joints: Array  #: (n_l,) torques [N m]
    volts: Array  #: (n_p, n_c) piezo voltages [V]
    piezo_tau: Array  #: (n_p, 3) the piezos' forces on the tip coordinates [N, N, N m]
    saturated: np.ndarray  #: (n_u,) whether each actuator is saturated, in the order of an action

    @property
    def command(self) -> Array:
        """The forces and voltages as one vector (n_u,), in the order of an action."""
        return np.concatenate([self.volts.ravel(), self.base, self.joints])


class Simulator(Shown):
    """The plant: rigid part, flexible panels, their coupling, pinned object, actuators with limits.

    Args:
        params: the robot; the paper's case study if left out.
        coupling: ``exact`` (all accelerations at once) or ``staggered`` (Fig. 1: the base feels the Q_flex of a step's
            start until its end; of first order); from the parameters if left out.
        integrator: ``etdrk4`` or ``rk4``; from the parameters if left out.
        max_step: longest integration step [s]; from the parameters if left out.

    Raises:
        ConfigError: if the parameters are out of range or the grasp cannot be closed.
        ValueError: for an unknown coupling or integrator.
    """

    def __init__(
        self,
        params: Params | None = None,
        *,
        coupling: str | None = None,
        integrator: str | None = None,
        max_step: float | None = None,
    ) -> None:
        given = {"coupling": coupling, "integrator": integrator, "max_step": max_step}
        overrides = [f"simulation.{key}={value}" for key, value in given.items() if value is not None]
        self.params = (params or load_params()).with_overrides(*overrides)
        self.model = pack(self.params)
        self.actuators = pack_actuators(self.params, self.model)
        self._beams = panel_beams(self.params)

    def _told(self) -> dict[str, object]:
        settings, (panels, modes) = self.params.simulation, self.model.omega2.shape
        return {
            "joints": len(self.model.link_mass), "panels": panels, "modes_per_panel": modes,
            "object": self.params.object is not None, "coupling": settings.coupling, "integrator": settings.integrator,
        }  # fmt: skip

    @cached_property
    def _plant(self) -> Plant:
        return Plant(self.model, INTEGRATORS[self.params.simulation.integrator])

    def __getstate__(self) -> dict[str, Any]:
        """Copy the robot; a copy has memory of its own."""
        return {name: value for name, value in self.__dict__.items() if name != "_plant"}

    def initial_state(self) -> State:
        """Return the configured start (Table IV), the object at rest relative to the grippers."""
        return self.unflatten(0.0, *initial_positions(self.params, self.model))

    def rest_state(self) -> State:
        """Return the configured start with straight panels and everything at rest."""
        p, _ = initial_positions(self.params, self.model)
        p[mode_slice(self.model)] = 0.0
        return self.unflatten(0.0, p, 0.0 * p)

    def reach(self, pose: ArrayLike | None = None, guess: ArrayLike | None = None) -> State:
        """Return a state at rest whose arms hold the object, at a pose (3,) in base axes; see :func:`reach.reach`."""
        p = held_positions(self.params, self.model, pose, guess)
        return self.unflatten(0.0, p, 0.0 * p)

    def step(
        self,
        state: State,
        base: ArrayLike | None = None,
        joints: ArrayLike | None = None,
        piezo_tau: ArrayLike | None = None,
        piezo_volts: ArrayLike | None = None,
        wrench: ArrayLike | None = None,
        dt: float | None = None,
    ) -> State:
        """Advance by ``dt`` under held actuator forces and return the new state; the given one is not touched.

        Args:
            state: where to start.
            base: (3,) thrust along the base axes [N, N, N m].
            joints: (n_l,) joint torques [N m].
            piezo_tau: (n_p, 3) desired piezo forces on the tip coordinates [N, N, N m].
            piezo_volts: (n_p, n_c) voltages [V], instead of ``piezo_tau``.
            wrench: (3,) force and moment of the surroundings on the base, base axes [N, N, N m]; they know no limit.
            dt: duration [s]; the control period if left out. Cut into steps of at most ``simulation.max_step``, or less
                for panels without damping, the classical method, or the staggered coupling.

        Raises:
            ValueError: for a state of another robot, a wrong shape, what is no finite number, in the state or the
                forces, a duration that is not positive, too short to move anything or too long to be computed in one
                call, or both ``piezo_tau`` and ``piezo_volts``.
            FloatingPointError: if the motion grows beyond all numbers within ``dt``.
        """
        dt = self._duration(dt)
        applied = self.applied(base, joints, piezo_tau, piezo_volts)
        tau = self._forces(applied)
        tau[:3] += _vector("wrench", wrench, (3,))
        state = self._own(state)
        p, v = self._plant.advance(*self._flat(state), tau, dt)
        if not (np.isfinite(p).all() and np.isfinite(v).all()):
            raise FloatingPointError(f"the motion grows beyond all numbers within dt = {dt:g} s")
        return unflatten(self.model, state.t + dt, p, v)

    def applied(
        self,
        base: ArrayLike | None = None,
        joints: ArrayLike | None = None,
        piezo_tau: ArrayLike | None = None,
        piezo_volts: ArrayLike | None = None,
    ) -> Applied:
        """Return what the actuators' limits leave of a command; arguments and errors as in :meth:`step`."""
        n_p, _, n_c = self.actuators.K_PZ.shape
        if piezo_tau is not None and piezo_volts is not None:
            raise ValueError("give piezo_tau or piezo_volts, not both")
        volts = _vector("piezo_volts", piezo_volts, (n_p, n_c))
        if piezo_tau is not None:
            volts = np.einsum("pcf,pf->pc", self.actuators.allocation, _vector("piezo_tau", piezo_tau, (n_p, N_TIP)))
        thrust, torques = _vector("base", base, (3,)), _vector("joints", joints, self.model.link_mass.shape)
        command = np.concatenate([volts.ravel(), thrust, torques])
        left = np.empty_like(command)
        saturate(self.actuators, command, left)
        volts, thrust, torques = self.split(left)
        forces = np.einsum("pfc,pc->pf", self.actuators.K_PZ, volts)
        return Applied(thrust, torques, volts, forces, left != command)

    def split(self, command: Array) -> tuple[Array, Array, Array]:
        """Return a command's (n_u,) piezo voltages (n_p, n_c), thrust (3,) and joint torques (n_l,)."""
        n_p, _, n_c = self.actuators.K_PZ.shape
        command = _vector("command", command, self.actuators.limit.shape)
        volts, base, joints = np.split(command, [n_p * n_c, n_p * n_c + N_BASE])
        return volts.reshape(n_p, n_c), base, joints

    def mass_matrix(self, state: State) -> Array:
        """Return M (N, N) over ``[q, qf of each panel]``, monolithic (Eqs. 41 and 45), nodal coordinates.

        Raises:
            ValueError: for foreshortened panels, as :meth:`bias`: theirs is not that of Eq. 45.
        """
        return self._assembled(self._own(state))[0]

    def bias(self, state: State) -> Array:
        """Return the bias h (N,) of ``M zdd + h = Q``: velocity terms, elastic forces and strain-rate damping."""
        return self._assembled(self._own(state))[1]

    def acceleration(self, state: State, **command: ArrayLike | None) -> tuple[Array, Array, Array]:
        """Return accelerations ``qdd (n,), qfdd (n_p, n_f), objdd (3,)`` under a command as in :meth:`step`."""
        _, a = self._evaluated(self._own(state), command)
        at = joint_slice(self.model).stop
        return a[:at], nodal(self.model, a[mode_slice(self.model)]), a[object_slice(self.model)]

    def energy(self, state: State) -> float:
        """Return the kinetic and strain energy of robot and object [J]."""
        return energy_of(self.model, *self._flat(self._own(state)))

    def momentum(self, state: State) -> Array:
        """Return linear momentum and angular momentum about the inertial origin (3,) [N s, N s, N m s]."""
        return momentum_of(self.model, *self._flat(self._own(state)))

    def q_flex(self, state: State, **command: ArrayLike | None) -> Array:
        """Return the generalised force (n,) of the panels on the rigid part, Eq. 4; commands as in :meth:`step`."""
        state = self._own(state)
        self._evaluated(state, command)
        force = np.zeros_like(state.q)
        force[:3] = flexible_wrench(self.model, self._flat(state)[1], self._plant.work.dynamics)
        return force

    def grasp_forces(self, state: State, **command: ArrayLike | None) -> Array:
        """Return the forces (n_g, 2) of the object on each gripper, inertial axes [N]; commands as in :meth:`step`."""
        state = self._own(state)
        self._evaluated(state, command)
        pins = self._plant.work.dynamics.grasps.pins
        return np.column_stack([pins.lam_x, pins.lam_y]) @ rotation(state.q[2]).T

    def constraint_drift(self, state: State) -> float:
        """Return the largest distance of a gripper from its grasp point [m]; 0 without an object."""
        state = self._own(state)
        if state.obj is None:
            return 0.0
        _, gap = monolithic.constraint_jacobian(self.model, state.q, state.qd, state.obj)
        return float(np.linalg.norm(gap.reshape(-1, 2), axis=1).max(initial=0.0))

    def frequencies(self, state: State) -> Array:
        """Return the undamped natural frequencies about a configuration at rest [rad/s], rigid motion left out.

        Of the panels' modes below the cuts, straight if they keep their length; with an object, of the motion that the
        pins allow.
        """
        return natural_frequencies(self.model, self._flat(self._own(state))[0])

    def linearize(self, state: State | None = None, **command: ArrayLike | None) -> LinearModel:
        """Return the linear model about a state, the start at rest if left out, and a command as in :meth:`step`.

        Of the exact coupling, and of what the limits leave of the command, which itself has none in the model.

        Raises:
            ValueError: for a state with open grasps or a straight grasping arm; else as :meth:`step`.
        """
        flat, command_left = self._flat(self._own(state or self.rest_state())), self.applied(**command).command
        return linear_model(self.params, self.model, self.actuators, self._plant, *flat, command_left)

    def _evaluated(self, state: State, command: dict[str, ArrayLike | None]) -> tuple[Array, Array]:
        """Return generalised forces and accelerations (n,); the rest of the equations stays in the buffers."""
        wrench = _vector("wrench", command.pop("wrench", None), (3,))
        tau = self._forces(self.applied(**command))
        tau[:3] += wrench
        return tau, self._plant.accelerations(*self._flat(state), tau)

    def _forces(self, applied: Applied) -> Array:
        """Return the generalised forces (n,) of an applied command."""
        tau = np.zeros(self.model.at.end)
        generalized_forces(self.model, self.actuators, applied.command, tau)
        return tau

    def _assembled(self, state: State) -> tuple[Array, Array]:
        if self.params.panel.foreshortening:
            raise ValueError("panel.foreshortening: Eqs. 45 and 48 are those of the linear panel; set it to false")
        return monolithic.assemble(self.model, self._beams, state.q, state.qd, state.qf, state.qfd)

    def _duration(self, dt: float | None) -> float:
        """Return the duration of a step [s]; raise ValueError for what is none, or cannot be computed."""
        if dt is None:
            return self.params.control.period
        if isinstance(dt, bool) or not isinstance(dt, int | float | np.floating | np.integer) or not 0.0 < dt < np.inf:
            raise ValueError(f"dt must be a positive number of seconds, got {dt!r}")
        if dt < SHORTEST_STEP:
            raise ValueError(f"dt must be at least {SHORTEST_STEP:g} s, got {dt!r}: nothing moves in less")
        if dt > (longest := MOST_STEPS * self.model.longest_step):
            raise ValueError(
                f"dt must be at most {longest:.3g} s, got {dt!r}: it would take more than {MOST_STEPS:.0e} integration "
                "steps; call step several times"
            )
        return float(dt)

    def _own(self, state: State) -> State:
        """Return a state as arrays of this robot's shapes; raise ValueError if it is not this robot's."""
        if not isinstance(state, State):
            raise ValueError(f"state must be a State, got {type(state).__name__}")
        n, elastic, body = (joint_slice(self.model).stop,), self.model.shapes.shape[:2], object_slice(self.model)
        shapes: dict[str, tuple[int, ...]] = {"t": (), "q": n, "qd": n, "qf": elastic, "qfd": elastic}
        if body.stop > body.start:
            shapes |= {"obj": (3,), "objd": (3,)}
        elif state.obj is not None or state.objd is not None:
            raise ValueError("state.obj and state.objd must be None for a robot that carries no object")
        arrays: dict[str, Any] = {}
        for name, shape in shapes.items():
            if (value := getattr(state, name)) is None:
                raise ValueError(f"state.{name} must have shape {shape}, got None")
            arrays[name] = _vector(f"state.{name}", value, shape)
        return replace(state, **arrays | {"t": float(arrays["t"])})

    def _flat(self, state: State) -> tuple[Array, Array]:
        """Return positions and velocities ``p, v`` (n,) of a state."""
        p, v = (
            np.concatenate([rigid, modal(self.model, elastic), [] if body is None else body])
            for rigid, elastic, body in ((state.q, state.qf, state.obj), (state.qd, state.qfd, state.objd))
        )
        return p, v

    def unflatten(self, t: float, p: Array, v: Array) -> State:
        """Return the state whose flat positions and velocities, as the kernels have them, are ``p, v`` (n,).

        Raises:
            ValueError: for another shape, or what is no finite number.
        """
        shape = (self.model.at.end,)
        t = float(_vector("t", t, ()))
        return unflatten(self.model, t, _vector("p", p, shape), _vector("v", v, shape))


def unflatten(model: Model, t: float, p: Array, v: Array) -> State:
    """Return the state of a robot whose kernels have the flat positions and velocities ``p, v`` (n,)."""
    at, elastic, body = joint_slice(model).stop, mode_slice(model), object_slice(model)
    has_object = body.stop > body.start
    return State(
        t, p[:at].copy(), v[:at].copy(), nodal(model, p[elastic]), nodal(model, v[elastic]),
        p[body].copy() if has_object else None, v[body].copy() if has_object else None,
    )  # fmt: skip


def _vector(name: str, value: ArrayLike | None, shape: tuple[int, ...]) -> Array:
    """Return a finite array of the given shape, zeros for None; raise ValueError for anything else."""
    if value is None:
        return np.zeros(shape)
    try:
        array = np.asarray(value)
    except ValueError:
        raise ValueError(f"{name} must have shape {shape}, got lists of different lengths") from None
    if array.dtype.kind not in "iuf":  # not booleans, texts, complex numbers, and what is larger than any float
        raise ValueError(f"{name} must consist of real numbers, got {array.dtype} {value!r}")
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    array = array.astype(np.float64)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} has entries that are not finite: {array.tolist()}")
    return array

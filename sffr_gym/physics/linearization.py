"""Linear models of the plant about a state: exact grasp constraints, named states, inputs and outputs.

The pins leave some of the coordinates free; the first two joints of each grasping arm follow from them. With the free
coordinates ``z`` and ``p = P(z)``, ``v = T zd`` (``J T = 0``, ``J`` that of the grasps' gaps), the plant is ``zdd =
a(P(z), T zd, u)``, and

    d(zdd)/dz = a_p T + a_v S      d(zdd)/d(zd) = a_v T      J S_j = -(d2 gap)(T_j, v)

so that no direction that the pins forbid, nor Baumgarte's terms, are left in the model. ``T`` and ``S`` are closed
forms; ``a`` is that of the compiled kernels, differentiated by central differences of tenth order (Fornberg,
Mathematics of Computation 51, 1988), which for these smooth functions are exact to rounding: what the formulas of tenth
and of eighth order differ by is kept as ``error``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from sffr_gym.config.params import Params
from sffr_gym.physics.actuators import Actuators, generalized_forces
from sffr_gym.physics.foreshortening import tip_foreshortening
from sffr_gym.physics.kinematics import arm_points, rotation
from sffr_gym.physics.model import N_BASE, Model, first_mode, joint_slice, mode_slice, object_slice
from sffr_gym.physics.monolithic import constraint_jacobian
from sffr_gym.physics.plant import Plant
from sffr_gym.types import Array, IntArray

if TYPE_CHECKING:
    from sffr_gym.physics.simulator import State

TENTH = np.array([5 / 6, -5 / 21, 5 / 84, -5 / 504, 1 / 1260])  # weights of (f(kh) - f(-kh)) / h, k = 1 to 5
EIGHTH = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280, 0.0])
STEP = 0.01  # rad, of angles; of other positions what moves the robot about as much
RATE_STEP = 1.0  # rad/s; accelerations are quadratic in rates, for which any step is exact
LARGEST_GAP = 1.0e-6  # m, of a grasp that counts as closed; what is left of it is closed exactly
LABELLED = ("states", "inputs", "outputs")
SINGULAR = 1.0e-6  # m2, least determinant of the two joints that place a gripper


class Label(NamedTuple):
    """What a number of a linear model is."""

    name: str
    unit: str  #: SI


@dataclass(frozen=True)
class LinearModel:
    """A linear model about an operating point: deviations ``x, u, y`` from it in SI units.

    Continuous (``period`` None): ``xd = A x + B u + drift``, ``y = C x + D u``; discrete, with inputs held over a
    period: ``x+ = A x + B u + drift``. ``drift`` is what the point itself does, zero at an equilibrium.
    """

    A: Array  #: (n, n)
    B: Array  #: (n, m)
    C: Array  #: (k, n)
    D: Array  #: (k, m)
    drift: Array  #: (n,) rates of the states at the operating point, or their change in a period
    states: tuple[Label, ...]  #: (n,) free coordinates, then their rates
    inputs: tuple[Label, ...]  #: (m,) in the order of a command
    outputs: tuple[Label, ...]  #: (k,)
    x0: Array  #: (n,) states of the operating point
    u0: Array  #: (m,) command of the operating point
    y0: Array  #: (k,) outputs of the operating point
    error: float  #: largest error of the derivatives, relative to the largest of the same direction
    free: IntArray  #: (n / 2,) where the states lie among all coordinates: base, joints, modes, object
    size: int  #: number of all coordinates
    modal: Array  #: (n_p, n_m, n_f) modal amplitudes of a panel's nodal coordinates
    control_period: float  #: of the robot [s]
    period: float | None = None  #: sampling period [s], None for a continuous model

    def discrete(self, period: float | None = None) -> LinearModel:
        """Return the model sampled with inputs held, by the matrix exponential.

        Args:
            period: sampling period [s]; the robot's control period if left out.

        Raises:
            ValueError: for a period that is not positive or too long for numbers, or if the model is discrete already.
        """
        period = self.control_period if period is None else float(period)
        if self.period is not None:
            raise ValueError(f"the model is sampled already, every {self.period:g} s")
        if not 0.0 < period < np.inf:
            raise ValueError(f"period must be a positive number of seconds, got {period!r}")
        n, m = self.B.shape
        whole = np.zeros((n + m + 1, n + m + 1))
        whole[:n] = np.column_stack([self.A, self.B, self.drift])
        with np.errstate(over="ignore", invalid="ignore"):
            sampled = expm(period * whole)[:n]
        if not np.isfinite(sampled).all():
            raise ValueError(f"period = {period:g} s: the model grows beyond all numbers in that time")
        return replace(
            self, A=sampled[:, :n], B=sampled[:, n : n + m], drift=sampled[:, -1], period=period
        )  # fmt: skip

    def deviation(self, state: State) -> Array:
        """Return the states ``x`` (n,) of the model for a state of the plant; ValueError for one of another robot."""
        (n_p, n_m, n_f), body = self.modal.shape, 0 if state.obj is None else len(state.obj)
        if state.qf.shape != (n_p, n_f) or len(state.q) + n_p * n_m + body != self.size:
            raise ValueError("the state is one of another robot than the model")
        parts = (state.q, state.qf, state.obj), (state.qd, state.qfd, state.objd)
        whole = [
            np.concatenate([rigid, np.einsum("pmf,pf->pm", self.modal, elastic).ravel(), [] if body is None else body])
            for rigid, elastic, body in parts
        ]
        return np.concatenate([each[self.free] for each in whole]) - self.x0

    def state_space(self) -> Any:
        """Return the ``scipy.signal.StateSpace`` of the deviations; the drift is no part of it."""
        from scipy.signal import StateSpace  # takes long to load

        return StateSpace(*self._matrices(), **({} if self.period is None else {"dt": self.period}))

    def control(self) -> Any:
        """Return the ``control.StateSpace`` of the package python-control, signals named.

        Raises:
            ModuleNotFoundError: if it is not installed.
        """
        import control  # optional

        names = {key: [label.name for label in getattr(self, key)] for key in LABELLED}
        return control.ss(*self._matrices(), 0 if self.period is None else self.period, **names)

    def find(self, kind: str, *names: str) -> list[int]:
        """Return the indices of states, inputs or outputs by name.

        Args:
            kind: ``states``, ``inputs`` or ``outputs``.
            names: of any number.

        Raises:
            KeyError: for a name that there is not.
        """
        if kind not in LABELLED:
            raise KeyError(f"{kind!r}: must be one of {', '.join(LABELLED)}")
        known = {label.name: k for k, label in enumerate(getattr(self, kind))}
        if unknown := [name for name in names if name not in known]:
            raise KeyError(f"{', '.join(map(str, unknown))}: no such {kind}; there are {', '.join(known)}")
        return [known[name] for name in names]

    def _matrices(self) -> tuple[Array, Array, Array, Array]:
        return self.A, self.B, self.C, self.D


class Tangent(NamedTuple):
    """The motion that the pins allow."""

    free: IntArray  #: (m,) indices of the free coordinates in ``p``
    T: Array  #: (n, m) motion of all coordinates for a unit of each
    S: Array  #: (n, m) change of all velocities with each at fixed free rates


def linear_model(
    params: Params, model: Model, actuators: Actuators, plant: Plant, p: Array, v: Array, command: Array
) -> LinearModel:
    """Return the linear model about flat positions and velocities ``p, v`` (n,) under a command (n_u,).

    Args:
        params: the robot.
        model: the same, packed.
        actuators: likewise.
        plant: its equations of motion.
        p: positions.
        v: velocities.
        command: of the actuators.

    Raises:
        ValueError: if a grasp is open, or an arm so straight that it can hold nothing.
        FloatingPointError: for a state so far out that nothing finite comes out.
    """
    p, v = closed(model, p, v)
    way, n, n_u = tangent(model, p, v), len(p), len(command)
    m = len(way.free)

    def force(command: Array) -> Array:
        tau = np.zeros(n)
        generalized_forces(model, actuators, np.where(actuators.limit > 0.0, command, 0.0), tau)  # of those there are
        return tau

    def all_of(p: Array, v: Array, tau: Array) -> Array:
        a, pins = plant.accelerations(p, v, tau), plant.work.dynamics.grasps.pins
        lam = np.column_stack([pins.lam_x, pins.lam_y]) @ rotation(p[2]).T
        return np.concatenate([a[way.free], _outputs(model, actuators, p, v), a[:N_BASE], lam.ravel()])

    columns, errors = [], []
    scale = _scales(params, model)
    tau = force(command)
    directions = [(way.T[:, j], way.S[:, j], 0 * tau, STEP / (abs(way.T[:, j]) / scale).max()) for j in range(m)]
    directions += [(0 * p, way.T[:, j], 0 * tau, RATE_STEP / (abs(way.T[:, j]) / scale).max()) for j in range(m)]
    directions += [(0 * p, 0 * v, force(unit), 1.0) for unit in np.eye(n_u)]
    for dp, dv, dtau, step in directions:
        differences = np.array([
            all_of(p + h * dp, v + h * dv, tau + h * dtau) - all_of(p - h * dp, v - h * dv, tau - h * dtau)
            for h in step * np.arange(1, len(TENTH) + 1)
        ]) / step  # fmt: skip
        columns.append(TENTH @ differences)
        largest = abs(columns[-1]).max(initial=0.0)
        errors.append(abs(columns[-1] - EIGHTH @ differences).max(initial=0.0) / largest if largest else 0.0)
    derivative, at = np.column_stack(columns), all_of(p, v, tau)
    if not (np.isfinite(derivative).all() and np.isfinite(at).all()):
        raise FloatingPointError("the equations of motion have no finite numbers at this state")
    A = np.zeros((2 * m, 2 * m))
    A[:m, m:], A[m:] = np.eye(m), derivative[:m, : 2 * m]
    labels = coordinate_labels(params, model)
    free = [labels[k] for k in way.free]
    return LinearModel(
        A=A, B=np.vstack([np.zeros((m, n_u)), derivative[:m, 2 * m :]]), C=derivative[m:, : 2 * m],
        D=derivative[m:, 2 * m :], drift=np.concatenate([v[way.free], at[:m]]), states=(*free, *map(rate_of, free)),
        inputs=command_labels(params, model, actuators), outputs=output_labels(params, model),
        x0=np.concatenate([p[way.free], v[way.free]]), u0=command.copy(), y0=at[m:], error=float(max(errors)),
        free=way.free, size=n, modal=model.inverse, control_period=params.control.period,
    )  # fmt: skip


def placing_joints(model: Model) -> IntArray:
    """Return the indices in ``p`` of the joints that place the grippers: the first two of each grasping arm."""
    return np.array([N_BASE + model.arm_first[arm] + k for arm in model.grasp_arm for k in (0, 1)], dtype=np.int64)


def closed(model: Model, p: Array, v: Array, gap: float = LARGEST_GAP) -> tuple[Array, Array]:
    """Return the state with its grasps closed to rounding, by the joints that place the grippers.

    Args:
        model: the robot.
        p: (n,) positions.
        v: (n,) velocities.
        gap: the largest one that is closed [m].

    Raises:
        ValueError: if a grasp is open by more than that, or an arm is straight.
    """
    p, v, bound = p.copy(), v.copy(), placing_joints(model)
    if not len(bound):
        return p, v
    for step in range(8):
        J, gaps = _constraints(model, p, v)
        if step == 0 and abs(gaps).max() > gap:
            raise ValueError(f"the state's grasps are open, by {abs(gaps).max():.3g} m: no linear model holds them")
        block = J[:, bound]
        for g in range(len(model.grasp_arm)):
            own = slice(2 * g, 2 * g + 2)
            if abs(np.linalg.det(block[own, own])) < SINGULAR:
                raise ValueError("a grasping arm is straight: its gripper can be moved in one direction only")
        p[bound] -= np.linalg.solve(block, gaps)
    v[bound] -= np.linalg.solve(block, J @ v)
    return p, v


def tangent(model: Model, p: Array, v: Array) -> Tangent:
    """Return the motion that the pins allow about a state with closed grasps."""
    n, bound = len(p), placing_joints(model)
    free = np.setdiff1d(np.arange(n), bound)
    T, S = np.eye(n)[:, free], np.zeros((n, len(free)))
    if len(bound):
        J, _ = _constraints(model, p, v)
        T[bound] = -np.linalg.solve(J[:, bound], J[:, free])
        bent = [(_curvature(model, p, T[:, j] + v) - _curvature(model, p, T[:, j] - v)) / 4 for j in range(len(free))]
        S[bound] = -np.linalg.solve(J[:, bound], np.column_stack(bent))
    return Tangent(free, T, S)


def coordinate_labels(params: Params, model: Model) -> list[Label]:
    """Return what the flat coordinates ``p`` are; see :mod:`sffr_gym.physics.model`."""
    labels = [Label("base_x", "m"), Label("base_y", "m"), Label("base_yaw", "rad")]
    labels += [Label(f"{arm.name}_joint{k + 1}", "rad") for arm in params.arms for k in range(len(arm.links))]
    modes = range(model.omega2.shape[1])
    labels += [Label(f"{mount.name}_mode{k + 1}", "kg^0.5 m") for mount in params.panel.mounts for k in modes]
    if params.object is not None:
        labels += [Label("object_x", "m"), Label("object_y", "m"), Label("object_phi", "rad")]
    return labels


def rate_of(label: Label) -> Label:
    """Return the label of a coordinate's rate."""
    return Label(f"{label.name}_rate", f"{label.unit}/s")


def command_labels(params: Params, model: Model, actuators: Actuators) -> tuple[Label, ...]:
    """Return what the numbers of a command are."""
    channels = range(actuators.K_PZ.shape[2])
    labels = [Label(f"{mount.name}_piezo{c + 1}", "V") for mount in params.panel.mounts for c in channels]
    labels += [Label("thrust_x", "N"), Label("thrust_y", "N"), Label("thrust_yaw", "N m")]
    return *labels, *(Label(f"{arm.name}_torque{k + 1}", "N m") for arm in params.arms for k in range(len(arm.links)))


def output_labels(params: Params, model: Model) -> tuple[Label, ...]:
    """Return what the outputs of a linear model are: coordinates, rates, base acceleration, grasp forces."""
    pose = coordinate_labels(params, model)
    pose = pose[: model.at.modes] + pose[object_slice(model)]
    kinds = (("axial", "m"), ("transverse", "m"), ("slope", "rad"))
    tips = [Label(f"{mount.name}_tip_{kind}", unit) for mount in params.panel.mounts for kind, unit in kinds]
    places = [*pose, *tips]
    grasps = params.object.grasps if params.object else ()
    forces = [Label(f"{grasp.arm}_grasp_{axis}", "N") for grasp in grasps for axis in "xy"]
    accelerations = (Label("base_x_acceleration", "m/s2"), Label("base_y_acceleration", "m/s2"))
    return *places, *map(rate_of, places), *accelerations, Label("base_yaw_acceleration", "rad/s2"), *forces


def _outputs(model: Model, actuators: Actuators, p: Array, v: Array) -> Array:
    """Return the outputs of a state that depend on it alone; see :func:`output_labels`."""
    parts = []
    inward = [tip_foreshortening(model, i, p, v) for i in range(len(model.panel_root))]
    for kind, values in enumerate((p, v)):
        tips = []
        for i in range(len(model.panel_root)):
            start = first_mode(model, i)
            tip = values[start : start + model.omega2.shape[1]] @ actuators.tips[i]
            tip[0] -= inward[i][kind]
            tips.append(tip)
        parts += [values[: model.at.modes], values[object_slice(model)], *tips]
    return np.concatenate(parts)


def _constraints(model: Model, p: Array, v: Array) -> tuple[Array, Array]:
    """Return the Jacobian (2 n_g, n) of the grasps' gaps over all coordinates, and the gaps (2 n_g,)."""
    rigid, body = slice(0, joint_slice(model).stop), object_slice(model)
    own, gap = constraint_jacobian(model, p[rigid], v[rigid], p[body])
    J = np.zeros((len(gap), len(p)))
    J[:, rigid], J[:, body] = own[:, rigid], own[:, rigid.stop :]
    return J, gap


def _curvature(model: Model, p: Array, w: Array) -> Array:
    """Return the gaps' second derivative (2 n_g,) along a velocity ``w`` (n,): their acceleration at rest of it."""
    rigid, body = slice(0, joint_slice(model).stop), object_slice(model)
    found = []
    for g, arm in enumerate(model.grasp_arm):
        _, tip = arm_points(model, p[rigid], w[rigid], int(arm))
        r = rotation(p[body][2]) @ model.grasp_point[g]
        found.append(tip.Jd_qd + w[body][2] ** 2 * r)
    return np.concatenate(found)


def _scales(params: Params, model: Model) -> Array:
    """Return what of each coordinate (n,) moves the robot about as much as a radian of a joint does."""
    length = model.link_length.mean() if len(model.link_length) else params.base.side
    place, scale = np.array([length, length, 1.0]), np.ones(model.at.end)
    scale[:N_BASE] = place
    scale[object_slice(model)] = place[: model.at.end - model.at.object]
    scale[mode_slice(model)] = np.repeat(0.1 * np.sqrt(3 * model.panel_second_moment), model.omega2.shape[1])
    return scale

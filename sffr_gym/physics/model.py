"""The robot as arrays: what the compiled kernels know of it, its coordinates, frames and signs.

Frames and signs, stated once::

                 left panel  (angle +pi/2)
                      ^ x_L
                      |
              y_L <---+            arm 1 ---o--- joint 2
                  .---------.      /
                  |   ^ y   |-----o  joint 1, at the arm's mount
     antenna o----|   |     |
                  |   +--> x|-----o  arm 2 ...
                  '---------'
                      |  base frame: origin at the base's centre of mass, turned by the yaw beta from the inertial axes
                      v
                 right panel (angle -pi/2)

- Angles are positive anticlockwise. A link's direction is ``beta + mount angle + sum of the joint angles up to it``.
- A panel's x axis runs from its root to its tip; axial displacement is positive along x, transverse along its y.
- ``Q_flex`` is the generalised force of the panels on the base: force along the inertial axes, moment about the base's
  centre of mass. The panel's root feels the opposite (Eq. 4 with the sign written out).
- A grasp force ``lam`` is the force of the object on the arm's tip; the object feels ``-lam``.
- Thrusters push along the base axes. A joint torque acts on its link, and its reaction on the link or base before it.

Positions ``p`` and velocities ``v`` of the plant are flat vectors: base ``x y beta`` (inertial), joint angles, each
panel's clamped modal amplitudes, the object's ``x y phi`` (inertial; absent without an object).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.workspace import Integers
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.beam import N_TIP, Beam, Modes
from sffr_gym.physics.each_panel import panel_beams, panel_modes
from sffr_gym.physics.foreshortening import (
    Foreshortening,
    foreshortening_shapes,
    make_foreshortening,
    no_foreshortening,
)
from sffr_gym.physics.staggered import longest_stable_step
from sffr_gym.types import Array, IntArray

N_BASE = 3  # x, y, yaw
N_BODY = 3  # a planar body's coordinates: the object's
RINGING = 0.9  # a stiff mode that keeps more than this of its amplitude over a step rings on
LARGEST_TURN = 2.4  # rad that the clamped frequency of such a mode may turn in a step
RK4_TURN = 2.0  # rad that any clamped frequency may turn in a step of the classical method, stable up to 2.8
MOST_STEPS = 10_000  # in a control period: some 20 ms of computing for 2 ms of a robot's
STIFF = 0.2  # modes whose natural frequency times the step exceeds this go into the exponential part of the integrator


class Index(NamedTuple):
    """The index map of the flat position and velocity vectors: where each part begins; the base begins at 0."""

    joints: int  #: first joint angle
    modes: int  #: first modal amplitude of the first panel
    object: int  #: the object's pose; ``end`` without an object
    end: int  #: length of the vectors


class StiffModes(NamedTuple):
    """Clamped modes that go into the exponential part of the integrator."""

    panel: IntArray  #: (n_s,) indices of each
    mode: IntArray  #: (n_s,)
    at: IntArray  #: (n_s,) index of its amplitude in ``p``
    omega: Array  #: (n_s,) frequencies [rad/s]


class Model(NamedTuple):
    """Constants of the robot, ready for the kernels; made by :func:`pack`.

    Arrays run over arms (n_a), links of all arms in order (n_l), panels (n_p), a panel's modes (n_m, the axial ones
    first), grasps (n_g) and stiff modes (n_s).
    """

    at: Index
    base_mass: float  #: [kg]
    base_inertia: float  #: [kg m2]
    arm_first: IntArray  #: (n_a + 1,) links of arm a are arm_first[a]:arm_first[a + 1]
    arm_mount: Array  #: (n_a, 2) [m] base frame
    arm_angle: Array  #: (n_a,) [rad] mount angle, base frame
    link_mass: Array  #: (n_l,) [kg]
    link_inertia: Array  #: (n_l,) [kg m2] about the link's centre of mass
    link_length: Array  #: (n_l,) [m]
    link_com: Array  #: (n_l,) [m] centre of mass from the link's joint
    panel_root: Array  #: (n_p, 2) [m] base frame
    panel_axis: Array  #: (n_p, 2) cosine and sine of the panel's angle, base frame
    panel_length: Array  #: (n_p,) [m]
    panel_mass: Array  #: (n_p,) [kg]
    panel_first_moment: Array  #: (n_p,) [kg m] about the root
    panel_second_moment: Array  #: (n_p,) [kg m2] about the root
    n_axial: int  #: axial modes of each panel
    omega2: Array  #: (n_p, n_m) squared clamped frequencies [rad2/s2]
    damping: Array  #: (n_p, n_m) strain-rate damping eta omega^2 [1/s]
    translation: Array  #: (n_p, n_m) axial: integral of rho a U, bending: of rho a W [kg^(1/2)]
    rotation: Array  #: (n_p, n_m) axial: integral of rho a x U, bending: of rho a x W [kg^(1/2) m]
    gyro: Array  #: (n_p, n_m - n_axial, n_axial) integral of rho a W U'
    shapes: Array  #: (n_p, n_f, n_m) nodal coordinates of the modes; q_f = shapes @ eta
    inverse: Array  #: (n_p, n_m, n_f) shapes' M_ff: eta = inverse @ q_f
    object_mass: float  #: 0 without an object
    object_inertia: float
    grasp_arm: IntArray  #: (n_g,) index of the arm that holds each grasp point
    grasp_point: Array  #: (n_g, 2) [m] object frame
    staggered: int  #: 1: Q_flex is held over a step (Fig. 1), else 0
    baumgarte: float  #: decay rate of constraint errors [1/s]
    longest_step: float  #: [s] of the integrator
    stiff: StiffModes
    eta: float  #: strain-rate damping [s]
    foreshortening: Foreshortening  #: of no length for linear panels


class Sizes(NamedTuple):
    """Numbers of a robot's parts.

    Attributes:
        arms, links, panels, modes, coordinates, grasps, stiff: n_a, n_l, n_p, n_m, n_f, n_g and n_s of :class:`Model`;
            modes, axial ones among them, and nodal coordinates are those of one panel.
        axial: axial modes of a panel.
        bent: modes of second order of a foreshortened panel, 0 for a linear one.
    """

    arms: int
    links: int
    panels: int
    modes: int
    axial: int
    coordinates: int
    grasps: int
    stiff: int
    bent: int


def model_sizes(model: Model) -> Sizes:
    """Return the numbers of a robot's parts."""
    panels, coordinates, modes = model.shapes.shape
    return Sizes(
        len(model.arm_mount), len(model.link_mass), panels, modes, model.n_axial, coordinates, len(model.grasp_arm),
        len(model.stiff.omega), model.foreshortening.tip.shape[1],
    )  # fmt: skip


def model_shapes(n):
    """Shapes of a :class:`Model`'s numbers and arrays, for :func:`sffr_gym.compile.workspace.structure`.

    n: :class:`Sizes`.
    """
    return Model(
        at=Index(Integers(()), Integers(()), Integers(()), Integers(())),
        base_mass=(), base_inertia=(),
        arm_first=Integers((n.arms + 1,)), arm_mount=(n.arms, 2), arm_angle=(n.arms,),
        link_mass=(n.links,), link_inertia=(n.links,), link_length=(n.links,), link_com=(n.links,),
        panel_root=(n.panels, 2), panel_axis=(n.panels, 2),
        panel_length=(n.panels,), panel_mass=(n.panels,), panel_first_moment=(n.panels,),
        panel_second_moment=(n.panels,),
        n_axial=Integers(()),
        omega2=(n.panels, n.modes), damping=(n.panels, n.modes),
        translation=(n.panels, n.modes), rotation=(n.panels, n.modes),
        gyro=(n.panels, n.modes - n.axial, n.axial),
        shapes=(n.panels, n.coordinates, n.modes), inverse=(n.panels, n.modes, n.coordinates),
        object_mass=(), object_inertia=(),
        grasp_arm=Integers((n.grasps,)), grasp_point=(n.grasps, 2),
        staggered=Integers(()), baumgarte=(), longest_step=(),
        stiff=StiffModes(Integers((n.stiff,)), Integers((n.stiff,)), Integers((n.stiff,)), (n.stiff,)), eta=(),
        foreshortening=foreshortening_shapes(n.panels, n.bent),
    )  # fmt: skip


@kernel
def first_mode(model, panel):
    """Index of a panel's first modal amplitude in ``p``."""
    return model.at.modes + panel * model.omega2.shape[1]


def joint_slice(model: Model) -> slice:
    """Joint angles in ``p``."""
    return slice(model.at.joints, model.at.modes)


def mode_slice(model: Model) -> slice:
    """Modal amplitudes in ``p``, panel by panel."""
    return slice(model.at.modes, model.at.object)


def object_slice(model: Model) -> slice:
    """The object's pose in ``p``; empty without an object."""
    return slice(model.at.object, model.at.end)


def pack(params: Params) -> Model:
    """Turn validated parameters into the arrays of the kernels.

    Raises:
        ConfigError: if a control period would take more integration steps than anyone can wait for.
    """
    links = [link for arm in params.arms for link in arm.links]
    panel, mounts = params.panel, params.panel.mounts
    beams, modes = panel_beams(params), panel_modes(params)
    omega, n_axial, n_p = np.array([each.omega for each in modes]), modes[0].n_axial, len(mounts)
    n_m = omega.shape[1]
    is_axial = np.arange(n_m) < n_axial
    longest_step = _longest_step(params, beams, modes)
    _check_steps(params, omega, longest_step)
    is_stiff = omega[:n_p] * longest_step > STIFF
    names = [arm.name for arm in params.arms]
    grasps = params.object.grasps if params.object else ()
    at = _index_map(len(links), n_p * n_m, params.object is not None)
    stiff_panel, stiff_mode = map(np.ascontiguousarray, np.nonzero(is_stiff))

    def of_each(values: Callable[[Beam, Modes], Any]) -> Array:
        """Return the constants of the panels, one after another."""
        kinds = [values(*each) for each in zip(beams, modes, strict=True)]
        return np.array(kinds, dtype=np.float64, order="C")[:n_p]

    return Model(
        at=at,
        base_mass=params.base.mass,
        base_inertia=params.base.inertia,
        arm_first=np.cumsum([0, *(len(arm.links) for arm in params.arms)]),
        arm_mount=np.array([arm.mount for arm in params.arms]).reshape(-1, 2),
        arm_angle=np.array([arm.mount_angle for arm in params.arms]),
        link_mass=np.array([link.mass for link in links]),
        link_inertia=np.array([link.inertia for link in links]),
        link_length=np.array([link.length for link in links]),
        link_com=np.array([link.com for link in links]),
        panel_root=np.array([mount.root for mount in mounts]).reshape(-1, 2),
        panel_axis=np.array([(np.cos(mount.angle), np.sin(mount.angle)) for mount in mounts]).reshape(-1, 2),
        panel_length=np.array([each.length for each in panel.each]),
        panel_mass=of_each(lambda beam, _: beam.mass),
        panel_first_moment=of_each(lambda beam, _: beam.first_moment),
        panel_second_moment=of_each(lambda beam, _: beam.second_moment),
        n_axial=n_axial,
        omega2=of_each(lambda _, own: own.omega**2),
        damping=of_each(lambda _, own: panel.strain_rate_damping * own.omega**2),
        translation=of_each(lambda beam, own: np.where(is_axial, beam.S_x @ own.shapes, beam.S_y @ own.shapes)),
        rotation=of_each(lambda beam, own: np.where(is_axial, beam.c_x @ own.shapes, beam.c_y @ own.shapes)),
        gyro=of_each(lambda beam, own: own.shapes[:, ~is_axial].T @ beam.N @ own.shapes[:, is_axial]),
        shapes=of_each(lambda _, own: own.shapes),
        inverse=of_each(lambda beam, own: own.shapes.T @ beam.M_ff),
        object_mass=params.object.mass if params.object else 0.0,
        object_inertia=params.object.inertia if params.object else 0.0,
        grasp_arm=np.array([names.index(grasp.arm) for grasp in grasps], dtype=np.int64),
        grasp_point=np.array([grasp.point for grasp in grasps]).reshape(-1, 2),
        staggered=int(params.simulation.coupling == "staggered"),
        baumgarte=params.simulation.baumgarte,
        longest_step=longest_step,
        stiff=StiffModes(stiff_panel, stiff_mode, at.modes + stiff_panel * n_m + stiff_mode, omega[:n_p][is_stiff]),
        eta=panel.strain_rate_damping,
        foreshortening=_foreshortening(params, beams, modes, omega[:n_p][is_stiff]),
    )


def _foreshortening(params: Params, beams: Sequence[Beam], modes: Sequence[Modes], stiff: Array) -> Foreshortening:
    """Return the integrals of foreshortened panels; raise ConfigError for modes that their integration cannot hold."""
    if not params.panel.foreshortening:
        return no_foreshortening(params.n_panels)
    if len(stiff):
        raise ConfigError(
            f"panel.bending_cut = {params.panel.bending_cut:g}: with panel.foreshortening no mode may turn more than "
            f"{STIFF:g} rad in an integration step, and the one at {stiff.min():.3g} rad/s does; lower the cut, or "
            "shorten simulation.max_step"
        )
    n_p = params.n_panels
    return make_foreshortening(params.panel.each, beams[:n_p], modes[:n_p])


def _index_map(n_links: int, n_amplitudes: int, has_object: bool) -> Index:
    """Lay base, joints, modal amplitudes and object one after another."""
    modes = N_BASE + n_links
    body = modes + n_amplitudes
    return Index(joints=N_BASE, modes=modes, object=body, end=body + (N_BODY if has_object else 0))


def steps_in(model: Model, duration: float) -> int:
    """Number of equal integration steps in a duration [s]."""
    return max(int(np.ceil(duration / model.longest_step - 1e-9)), 1)


def _longest_step(params: Params, beams: Sequence[Beam], modes: Sequence[Modes]) -> float:
    """The configured longest step, or less for the classical method, and for stiff modes that ring on and on.

    A stiff mode that turns by 2 pi within a step looks like slow motion to the integrator's stages. Damped as it is by
    default, its vibration is gone after a few steps and does no harm; else a step is kept below half a turn. The free
    robot's axial modes lie up to a third above the clamped ones. The staggered coupling has a limit of its own.
    """
    omega, longest = np.concatenate([each.omega for each in modes]), params.simulation.max_step
    if params.simulation.coupling == "staggered":
        longest = longest_stable_step(params, beams, modes)
        if longest < params.simulation.max_step:
            warnings.warn(
                f"simulation.max_step = {params.simulation.max_step:g} s is too long for simulation.coupling = "
                f"staggered, with which these panels swing up; steps of at most {longest:.3g} s are taken",
                stacklevel=2,  # one place, so that it is shown once
            )
    if params.simulation.integrator == "rk4":
        return min(longest, RK4_TURN / omega.max(initial=RK4_TURN / longest))
    decay = np.exp(-0.5 * params.panel.strain_rate_damping * omega**2 * longest)
    ringing = omega[(decay > RINGING) & (omega * longest > LARGEST_TURN)]
    return LARGEST_TURN / ringing.max() if len(ringing) else longest


def _check_steps(params: Params, omega: Array, longest: float) -> None:
    """Raise ConfigError if steps of at most ``longest`` [s] make a control period take for ever."""
    steps = params.control.period / longest
    if steps > MOST_STEPS:
        raise ConfigError(
            f"control.period = {params.control.period:g}: would take about {steps:.1g} integration steps of "
            f"{longest:.1g} s, at most {MOST_STEPS}: shorten it, lengthen simulation.max_step, or leave out fast modes "
            f"(up to {omega.max(initial=0.0):.3g} rad/s) with panel.axial_cut and panel.bending_cut"
        )


def nodal(model: Model, amplitudes: Array) -> Array:
    """Elastic coordinates ``q_f`` (n_p, n_f) of all nodes from the modal amplitudes (n_p * n_m,)."""
    return np.einsum("pfm,pm->pf", model.shapes, amplitudes.reshape(model.omega2.shape))


def modal(model: Model, q_f: Array) -> Array:
    """Modal amplitudes (n_p * n_m,) of nodal elastic coordinates (n_p, n_f); the part above the cuts is lost."""
    return np.einsum("pmf,pf->pm", model.inverse, q_f).ravel()


def tip_rows(model: Model) -> Array:
    """Rows of ``shapes`` that give the tip node's axial, transverse and slope coordinates, (n_p, 3, n_m)."""
    return model.shapes[:, -N_TIP:, :]

"""Sections of the parameters: frozen, validated models in SI units that mirror ``configs/sffr.yaml`` key for key.

The tables and equations of the paper are cited in that file. ``params.py`` has the root.
"""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError, field_validator, model_validator
from pydantic_core import InitErrorDetails

from sffr_gym.config.strict_yaml import TAG, check_error

TIP_COORDINATES = ("q4", "q5", "q6")  # a panel tip's axial and transverse displacement and slope, as the paper counts
ALL, EACH = f"{TAG}all", f"{TAG}each"  # forms of the panels' initial state

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Angle = Annotated[float, Field(ge=-2.0 * math.pi, le=2.0 * math.pi)]  # more than a turn is taken for degrees
Duration = Annotated[float, Field(gt=0.0, le=0.1)]  # longer is taken for milliseconds
Name = Annotated[str, Field(min_length=1)]
Vec2 = tuple[float, float]
Vec3 = tuple[float, float, float]
Spans = Annotated[tuple[Vec2, ...], Field(min_length=1)]
NonNegative3 = tuple[NonNegative, NonNegative, NonNegative]


def error_at(key: tuple[str | int, ...], value: Any, reason: str) -> InitErrorDetails:
    """Return an error that pydantic reports at a key below the model that is being checked."""
    return InitErrorDetails(type=check_error(reason), loc=key, input=value)


def raise_errors(errors: list[InitErrorDetails]) -> None:
    """Raise the errors together, if there are any."""
    if errors:
        raise ValidationError.from_exception_data("Params", errors)


def tip_form(value: Any) -> str:
    """Return ``ALL`` for three numbers that hold for all the panels, ``EACH`` for a list of them for each."""
    is_list = isinstance(value, list | tuple)
    return EACH if is_list and all(isinstance(entry, list | tuple) for entry in value) else ALL


TipState = Annotated[
    Annotated[Vec3, Tag(ALL)] | Annotated[tuple[Vec3, ...], Tag(EACH)],
    Discriminator(tip_form),
]


class Section(BaseModel):
    """A mapping of the file: immutable, complete, without unknown keys, and without conversion of types."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _lists_to_tuples(cls, value: Any) -> Any:
        return _to_tuple(value)


class Base(Section):
    """The rigid base of the robot."""

    mass: Positive = Field(description="mass [kg]")
    inertia: Positive = Field(description="moment of inertia about the centre of mass [kg m2]")
    side: Positive = Field(description="side of the square body [m]")


class Link(Section):
    """A rigid link of an arm."""

    mass: Positive = Field(description="mass [kg]")
    length: Positive = Field(description="distance from its joint to the next [m]")
    inertia: Positive = Field(description="moment of inertia about the centre of mass [kg m2]")
    com: NonNegative = Field(description="distance from its joint to the centre of mass [m]")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.com > self.length:
            raise_errors([error_at(("com",), self.com, f"must be at most the link's length {self.length:g} [m]")])
        return self


class Arm(Section):
    """A serial chain of links with revolute joints; an antenna and a camera are arms too."""

    name: Name = Field(description="unique name [-]")
    mount: Vec2 = Field(description="place of the first joint in the base frame [m]")
    mount_angle: Angle = Field(description="turn of the first joint's zero from the base x axis [rad]")
    links: tuple[Link, ...] = Field(min_length=1, description="links from the base outwards")


class PanelMount(Section):
    """Where a panel is clamped to the base."""

    name: Name = Field(description="unique name [-]")
    root: Vec2 = Field(description="place of the clamped end in the base frame [m]")
    angle: Angle = Field(description="direction of the undeformed panel in the base frame [rad]")


class Panel(Section):
    """The flexible panel, one beam model for all the mounts."""

    mass: Positive = Field(description="mass of one panel [kg]")
    length: Positive = Field(description="length [m]")
    EI: Positive = Field(description="bending stiffness [N m2]")
    E: Annotated[float, Field(ge=1.0e6)] = Field(description="Young's modulus [Pa]")
    area: Annotated[float, Field(gt=0.0, le=1.0)] = Field(description="area of the cross-section [m2]")
    elements: Annotated[int, Field(ge=1, le=64)] = Field(description="number of beam elements per panel [-]")
    strain_rate_damping: NonNegative = Field(description="Kelvin-Voigt eta in D = eta K [s]")
    axial_cut: Positive = Field(description="clamped axial modes above this frequency are left out [rad/s]")
    bending_cut: Positive = Field(description="clamped bending modes above this frequency are left out [rad/s]")
    mounts: tuple[PanelMount, ...] = Field(description="one entry for each panel")


class Grasp(Section):
    """An end-effector pinned to a point of the object."""

    arm: Name = Field(description="name of the grasping arm [-]")
    point: Vec2 = Field(description="grasped point in the object's frame [m]")


class Object(Section):
    """The rigid object that the arms carry."""

    mass: Positive = Field(description="mass [kg]")
    inertia: Positive = Field(description="moment of inertia about the centre of mass [kg m2]")
    grasps: tuple[Grasp, ...] = Field(min_length=1, description="one entry for each grasping arm")


class Piezo(Section):
    """The piezoelectric actuators of each panel."""

    array: Literal["generalized", "patches", "tip"] = Field(description="what the channels act on [-]")
    force: Positive = Field(description="force at full voltage: of a patch, on the axial, transverse coordinate [N]")
    moment: Positive = Field(description="moment at full voltage on the tip slope [N m]")
    voltage: Positive = Field(description="full voltage [V]")
    patches: Spans = Field(description="patch pairs near the root, each from and to, as parts of the length [-]")
    tip: Spans = Field(description="patch pairs at the tip, likewise [-]")

    @field_validator("patches", "tip")
    @classmethod
    def _check_spans(cls, spans: tuple[Vec2, ...]) -> tuple[Vec2, ...]:
        end = 0.0
        for start, stop in spans:
            if not end <= start < stop <= 1.0:
                raise check_error(
                    "must be spans [from, to] with 0 <= from < to <= 1, none beginning before the last one ends"
                )
            end = stop
        return spans


class Actuators(Section):
    """Limits of the thrusters, the joints and the piezoelectric actuators."""

    thruster_force: Positive = Field(description="largest force on each body axis [N]")
    thruster_torque: Positive = Field(description="largest torque on the base [N m]")
    joint_torque: Positive = Field(description="largest torque of each joint [N m]")
    piezo: Piezo = Field(description="piezoelectric actuators")


class Initial(Section):
    """The initial state."""

    q: tuple[float, ...] = Field(description="base x, y, yaw, then the joint angles, arm by arm [m, rad]")
    qd: tuple[float, ...] = Field(description="their rates [m/s, rad/s]")
    qf: TipState = Field(description="tip's axial, transverse, slope, of every panel or a list of each [m, m, rad]")
    qfd: TipState = Field(description="their rates [m/s, m/s, rad/s]")


class Path(Section):
    """The circle that the object is carried around."""

    radius: Positive = Field(description="radius of the circle [m]")
    speed: Positive = Field(description="speed along the circle [m/s]")
    heading: Literal["fixed", "tangent"] = Field(description="whether base and object turn with the path [-]")

    @property
    def period(self) -> float:
        """Time of one turn around the circle [s]."""
        return 2.0 * math.pi * self.radius / self.speed


class Control(Section):
    """Sampling and gains of the task-space control."""

    period: Duration = Field(description="control period [s]")
    Kp: Positive = Field(description="stiffness of the error dynamics edd + Kd ed + Kp e = 0 [1/s2]")
    Kd: Positive = Field(description="damping of the error dynamics edd + Kd ed + Kp e = 0 [1/s]")

    @property
    def longest_period(self) -> float:
        """Control period beyond which the sampled error dynamics is unstable [s].

        A double integrator under ``u = -Kp e - Kd ed``, held over a period T, has the characteristic polynomial
        ``z^2 - (2 - Kd T - Kp T^2 / 2) z + 1 - Kd T + Kp T^2 / 2``. Its roots lie inside the unit circle if and only if
        ``T < 2 / Kd`` and ``T < 2 Kd / Kp``.
        """
        return min(2.0 / self.Kd, 2.0 * self.Kd / self.Kp)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.period >= self.longest_period:
            reason = f"must be less than {self.longest_period:.4g} [s] with Kp = {self.Kp:g} and Kd = {self.Kd:g}"
            raise_errors([error_at(("period",), self.period, f"{reason}, or the sampled loop is unstable")])
        return self


class Suppression(Section):
    """Virtual damping of the panels and its adaptation."""

    coordinates: Literal["auto", "all"] | tuple[Literal["q4", "q5", "q6"], ...] = Field(
        description="damped tip coordinates [-]"
    )
    B0: NonNegative3 = Field(description="initial virtual damping [N s/m, N s/m, N m s/rad]")
    Gamma: NonNegative3 = Field(description="adaptation gain of each coordinate [SI]")
    psi: Positive = Field(description="weight of e in the filtered output ed + psi e [1/s]")

    @field_validator("coordinates", mode="before")
    @classmethod
    def _check_coordinates(cls, value: Any) -> Any:
        names = _to_tuple(value)
        distinct = isinstance(names, tuple) and 0 < len(names) == len([n for n in TIP_COORDINATES if n in names])
        if not distinct and value not in ("auto", "all"):
            raise check_error(f"must be auto, all, or a list of different names out of {', '.join(TIP_COORDINATES)}")
        return names


class Simulation(Section):
    """Numerical settings of the simulation."""

    coupling: Literal["exact", "staggered"] = Field(description="how rigid and elastic motion are coupled [-]")
    integrator: Literal["etdrk4", "rk4"] = Field(description="integration method [-]")
    max_step: Duration = Field(description="longest integration step [s]")
    baumgarte: NonNegative = Field(description="decay rate of drift from the grasp constraints [1/s]")


class Limits(Section):
    """What ends an episode, and the range of the observation."""

    tip: Positive = Field(description="largest tip deflection, as a part of the panel's length [-]")
    arm_singularity: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(description="least |sin| of an elbow angle [-]")
    grasp_gap: Positive = Field(description="gap at which a grasp is lost [m]")
    position: Positive = Field(description="range of position errors [m]")
    angle: Positive = Field(description="range of orientation errors and joint angles [rad]")
    velocity: Positive = Field(description="range of velocities [m/s]")
    rate: Positive = Field(description="range of angular rates [rad/s]")


class RewardTerm(Section):
    """One term of the reward."""

    weight: NonNegative = Field(description="cost per second at the scale [1/s]")
    scale: Positive = Field(description="size of the measure that costs the weight [m, J or V]")


class Reward(Section):
    """The terms of the reward."""

    tracking: RewardTerm = Field(description="object position error, scale in m")
    vibration: RewardTerm = Field(description="bending energy about the quasi-static shape, scale in J")
    effort: RewardTerm = Field(description="root mean square piezo voltage, scale in V")


def _to_tuple(value: Any) -> Any:
    return tuple(_to_tuple(entry) for entry in value) if isinstance(value, list | tuple) else value

"""Sections of the parameters: frozen, validated models in SI units that mirror ``configs/sffr.yaml`` key for key.

The tables and equations of the paper are cited in that file. ``params.py`` has the root.
"""

import functools
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    TypeAdapter,
    field_validator,
    model_validator,
)

from sffr_gym.config.field_errors import error_at, raise_errors
from sffr_gym.config.ranges import (
    Angle,
    AngleBound,
    Area,
    BendingStiffness,
    Bound,
    Damping,
    Decay,
    FilterRate,
    Inertia,
    IntegralGain,
    Length,
    Mass,
    ModeCut,
    Name,
    NoiseLevel,
    Offset,
    Period,
    Place,
    Position,
    PositionGain,
    Rate,
    RateGain,
    Reach,
    Relaxation,
    Scale,
    Share,
    Sine,
    Slope,
    Velocity,
    Weight,
    YoungsModulus,
    at_most,
)
from sffr_gym.config.strict_yaml import TAG, check_error

PANEL_KEYS = ("mass", "length", "EI")  # that a panel may have of its own
TIP_COORDINATES = ("q4", "q5", "q6")  # a panel tip's axial and transverse displacement and slope, as the paper counts
ALL, EACH = f"{TAG}all", f"{TAG}each"  # forms of the panels' initial state

# Each part of a robot costs in every step, and in the search of its modes: a robot of all of them takes milliseconds.
MOST_ARMS, MOST_LINKS, MOST_PANELS, MOST_ELEMENTS = 16, 32, 16, 64
COSTS = "each costs in every step"

Place2 = tuple[Place, Place]
Damping3 = tuple[Damping, Damping, Damping]
Tip = tuple[Place, Place, Slope]
TipRate = tuple[Velocity, Velocity, Rate]


def tip_form(value: Any) -> str:
    """Return ``ALL`` for three numbers that hold for all the panels, ``EACH`` for a list of them for each."""
    is_list = isinstance(value, list | tuple)
    return EACH if is_list and all(isinstance(entry, list | tuple) for entry in value) else ALL


TipState = Annotated[
    Annotated[Tip, Tag(ALL)] | Annotated[tuple[Tip, ...], Tag(EACH)],
    Discriminator(tip_form),
]
TipMotion = Annotated[
    Annotated[TipRate, Tag(ALL)] | Annotated[tuple[TipRate, ...], Tag(EACH)],
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

    mass: Mass = Field(description="mass [kg]")
    inertia: Inertia = Field(description="moment of inertia about the centre of mass [kg m2]")
    side: Length = Field(description="side of the square body [m]")


class Link(Section):
    """A rigid link of an arm."""

    mass: Mass = Field(description="mass [kg]")
    length: Length = Field(description="distance from its joint to the next [m]")
    inertia: Inertia = Field(description="moment of inertia about the centre of mass [kg m2]")
    com: Offset = Field(description="distance from its joint to the centre of mass [m]")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.com > self.length:
            raise_errors([error_at(("com",), self.com, f"must be at most the link's length {self.length:g} [m]")])
        return self


class Arm(Section):
    """A serial chain of links with revolute joints; an antenna and a camera are arms too."""

    name: Name = Field(description="unique name [-]")
    mount: Place2 = Field(description="place of the first joint in the base frame [m]")
    mount_angle: Angle = Field(description="turn of the first joint's zero from the base x axis [rad]")
    links: Annotated[tuple[Link, ...], at_most(MOST_LINKS, COSTS)] = Field(
        min_length=1, description="links from the base outwards"
    )


class PanelMount(Section):
    """Where a panel is clamped to the base, and what it has of its own."""

    name: Name = Field(description="unique name [-]")
    root: Place2 = Field(description="place of the clamped end in the base frame [m]")
    angle: Angle = Field(description="direction of the undeformed panel in the base frame [rad]")
    mass: Mass | None = Field(default=None, description="mass of this panel, null: panel.mass [kg]")
    length: Length | None = Field(default=None, description="length of this panel, null: panel.length [m]")
    EI: BendingStiffness | None = Field(default=None, description="stiffness of this panel, null: panel.EI [N m2]")

    @property
    def own(self) -> dict[str, float]:
        """What this panel does not share with the others, by key of the section ``panel``."""
        return {key: value for key in PANEL_KEYS if (value := getattr(self, key)) is not None}


class Panel(Section):
    """The flexible panels: one beam model, whose mass, length and stiffness a mount may replace by its own."""

    mass: Mass = Field(description="mass of one panel [kg]")
    length: Length = Field(description="length [m]")
    EI: BendingStiffness = Field(description="bending stiffness [N m2]")
    E: YoungsModulus = Field(description="Young's modulus [Pa]")
    area: Area = Field(description="area of the cross-section [m2]")
    elements: int = Field(ge=1, le=MOST_ELEMENTS, description="number of beam elements per panel [-]")
    strain_rate_damping: Relaxation = Field(description="Kelvin-Voigt eta in D = eta K [s]")
    foreshortening: bool = Field(description="whether points are drawn inwards as the panel bends [-]")
    axial_cut: ModeCut = Field(description="clamped axial modes above this frequency are left out [rad/s]")
    bending_cut: ModeCut = Field(description="clamped bending modes above this frequency are left out [rad/s]")
    mounts: Annotated[tuple[PanelMount, ...], at_most(MOST_PANELS, COSTS)] = Field(
        description="one entry for each panel"
    )

    @property
    def each(self) -> tuple[Self, ...]:
        """The panels, mount by mount, each with the mass, length and EI that it has; alike ones are the same object."""
        kinds: dict[tuple[float, ...], Self] = {self.numbers: self}
        own = [self.model_copy(update=mount.own) if mount.own else self for mount in self.mounts]
        return tuple(kinds.setdefault(panel.numbers, panel) for panel in own)

    @property
    def numbers(self) -> tuple[float, ...]:
        """What a mount may replace, in the order of ``PANEL_KEYS``."""
        return tuple(getattr(self, key) for key in PANEL_KEYS)


class Grasp(Section):
    """An end-effector pinned to a point of the object."""

    arm: Name = Field(description="name of the grasping arm [-]")
    point: Place2 = Field(description="grasped point in the object's frame [m]")


class Object(Section):
    """The rigid object that the arms carry."""

    mass: Mass = Field(description="mass [kg]")
    inertia: Inertia = Field(description="moment of inertia about the centre of mass [kg m2]")
    grasps: tuple[Grasp, ...] = Field(min_length=1, description="one entry for each grasping arm")


class Initial(Section):
    """The initial state; without ``qd`` robot and object move as one, at the path's speed and with its heading."""

    q: tuple[float, ...] = Field(description="base x, y, yaw, then the joint angles, arm by arm [m, rad]")
    reach: Reach | None = Field(description="where joint angles shall hold the object: auto, or a pose [m, rad]")
    qd: tuple[float, ...] | None = Field(description="their rates, null: along the path [m/s, rad/s]")
    qf: TipState = Field(description="tip's axial, transverse, slope, of every panel or a list of each [m, m, rad]")
    qfd: TipMotion = Field(description="their rates [m/s, m/s, rad/s]")

    @field_validator("q")
    @classmethod
    def _check_q(cls, q: tuple[float, ...]) -> tuple[float, ...]:
        return _coordinates(Position, Angle, len(q)).validate_python(q)

    @field_validator("qd")
    @classmethod
    def _check_qd(cls, qd: tuple[float, ...] | None) -> tuple[float, ...] | None:
        return None if qd is None else _coordinates(Velocity, Rate, len(qd)).validate_python(qd)


class Observer(Section):
    """What an observer believes of noise: of the measurements, and of what accelerates the robot unknown to it."""

    position: NoiseLevel = Field(description="rms of measured position errors [m]")
    angle: NoiseLevel = Field(description="rms of measured angle errors [rad]")
    velocity: NoiseLevel = Field(description="rms of their measured rates [m/s]")
    rate: NoiseLevel = Field(description="rms of their measured rates [rad/s]")
    acceleration: NoiseLevel = Field(description="rms of unknown accelerations over a control period [m/s2]")
    angular_acceleration: NoiseLevel = Field(description="the same of angles [rad/s2]")


class Control(Section):
    """Sampling and gains of the task-space control."""

    period: Period = Field(description="control period [s]")
    Kp: PositionGain = Field(description="stiffness of the error dynamics edd + Kd ed + Kp e = 0 [1/s2]")
    Kd: RateGain = Field(description="damping of the error dynamics edd + Kd ed + Kp e = 0 [1/s]")
    Ki: IntegralGain = Field(description="gain of the errors' integral, 0: the paper's law [1/s3]")
    feedforward: bool = Field(description="whether the panels' predicted reaction is added to the base's wrench [-]")
    delay_compensation: bool = Field(description="whether sensors are watched for a lag of a control period [-]")
    shaper: Literal["none", "zv", "zvd"] = Field(description="input shaping of a path that ends at rest [-]")
    observer: Observer | None = Field(description="noise for a Kalman filter of the errors, null: as measured")

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
        if self.Ki >= self.Kp * self.Kd:  # Hurwitz
            reason = f"must be less than Kp Kd = {self.Kp * self.Kd:.4g} [1/s3], or the error dynamics is unstable"
            raise_errors([error_at(("Ki",), self.Ki, reason)])
        if self.period >= self.longest_period:
            reason = f"must be less than {self.longest_period:.4g} [s] with Kp = {self.Kp:g} and Kd = {self.Kd:g}"
            raise_errors([error_at(("period",), self.period, f"{reason}, or the sampled loop is unstable")])
        return self


class Suppression(Section):
    """Virtual damping of the panels and its adaptation."""

    coordinates: Literal["auto", "all"] | tuple[Literal["q4", "q5", "q6"], ...] = Field(
        description="damped tip coordinates [-]"
    )
    B0: Damping3 = Field(description="initial virtual damping [N s/m, N s/m, N m s/rad]")
    Gamma: Damping3 = Field(description="adaptation gain of each coordinate [SI]")
    psi: FilterRate = Field(description="weight of e in the filtered output ed + psi e [1/s]")

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
    max_step: Period = Field(description="longest integration step [s]")
    baumgarte: Decay = Field(description="decay rate of drift from the grasp constraints [1/s]")


class Limits(Section):
    """What ends an episode, and the range of the observation."""

    tip: Share = Field(description="largest tip deflection, as a part of the panel's length [-]")
    arm_singularity: Sine = Field(description="least |sin| of an elbow angle [-]")
    grasp_gap: Bound = Field(description="gap at which a grasp is lost [m]")
    position: Bound = Field(description="range of position errors [m]")
    angle: AngleBound = Field(description="range of orientation errors and joint angles [rad]")
    velocity: Bound = Field(description="range of velocities [m/s]")
    rate: Bound = Field(description="range of angular rates [rad/s]")


class RewardTerm(Section):
    """One term of the reward."""

    weight: Weight = Field(description="most that the term gives in a control period [-]")
    scale: Scale = Field(description="size of the measure from which the term falls [m, J or V]")


class Reward(Section):
    """The terms of the reward."""

    tracking: RewardTerm = Field(description="object position error, scale in m")
    vibration: RewardTerm = Field(description="bending energy about the quasi-static shape, scale in J")
    effort: RewardTerm = Field(description="root mean square piezo voltage, scale in V")


@functools.cache
def _coordinates(place: Any, angle: Any, count: int) -> TypeAdapter[tuple[float, ...]]:
    """Return what checks the first two of ``count`` coordinates as places and the others as angles, or their rates."""
    return TypeAdapter(tuple[(place, place, *[angle] * count)[:count]])  # type: ignore[arg-type, misc]


def _to_tuple(value: Any) -> Any:
    return tuple(_to_tuple(entry) for entry in value) if isinstance(value, list | tuple) else value

"""Ranges of the numbers in files and arguments, each with its reason.

An end lies where a value can only be a mistaken unit, where numbers would lose the digits that matter beside each other
(float64 has 16), or where the cost is out of all proportion. Robots that fly or stand in a laboratory are far from it.
What costs in combination, such as steps in a control period, is checked where the combination is known.
"""

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag

from sffr_gym.config.strict_yaml import TAG, check_error

LONGEST_NAME = 64  # characters: names stand in tables, legends and file names
LONGEST_TEXT = 1000
LARGEST_CUT = 1.0e9  # rad/s
MOST_ENVS = 100_000  # of a batch: half a GB, and a reset of all takes half a minute
LARGEST_SEED = 2**32 - 1  # what every generator takes that a seed is handed to

# Bodies. Between the least and the largest mass lie 18 decades: a speck of dust beside an asteroid, which the mass
# matrix only just tells from nothing. A moment of inertia is a mass times the square of a length.
Mass = Annotated[float, Field(ge=1.0e-9, le=1.0e9)]  # kg
Length = Annotated[float, Field(ge=1.0e-3, le=1.0e3)]  # m; shorter is taken for km, longer for mm
Inertia = Annotated[float, Field(ge=1.0e-15, le=1.0e15)]  # kg m2
Offset = Annotated[float, Field(ge=0.0, le=1.0e3)]  # m along a link
Place = Annotated[float, Field(ge=-1.0e3, le=1.0e3)]  # m, a coordinate in a body's frame
Angle = Annotated[float, Field(ge=-2.0 * math.pi, le=2.0 * math.pi)]  # rad; more than a turn is taken for degrees

# Panels.
BendingStiffness = Annotated[float, Field(ge=1.0e-9, le=1.0e12)]  # N m2: a hair, a bridge
YoungsModulus = Annotated[float, Field(ge=1.0e6, le=1.0e13)]  # Pa: rubber; less is taken for GPa
Area = Annotated[float, Field(ge=1.0e-12, le=1.0)]  # m2; more is taken for cm2
Relaxation = Annotated[float, Field(ge=0.0, le=10.0)]  # s; with more of it no panel vibrates, it creeps
ModeCut = Annotated[float, Field(ge=1.0e-6, le=LARGEST_CUT)]  # rad/s; beyond lies no mode of a panel in these ranges

# Where an object is to be held: wherever that is best, or at a pose.
Reach = Annotated[
    Annotated[Literal["auto"], Tag(f"{TAG}auto")] | Annotated[tuple[Place, Place, Angle], Tag(f"{TAG}pose")],
    Discriminator(lambda value: f"{TAG}pose" if isinstance(value, list | tuple) else f"{TAG}auto"),
]

# Actuators: a limit that never acts is written as a large number, and what it divides stays finite.
Limit = Annotated[float, Field(ge=1.0e-9, le=1.0e9)]  # N, N m, V
TimeConstant = Annotated[float, Field(ge=0.0, le=100.0)]  # s; longer is taken for milliseconds
Quantum = Annotated[float, Field(ge=0.0, le=1.0e9)]  # V, N, N m, as the limits; 0 is none
OnTime = Annotated[float, Field(ge=0.0, le=10.0)]  # s, of a valve
TriggerGain = Annotated[float, Field(ge=1.0e-3, le=1.0e3)]  # of a command that is at most 1

# State. The start lies near enough to the origin that rounding is far below what the reward resolves (1e-5 m), and its
# rates stay within what an episode can begin with.
Position = Annotated[float, Field(ge=-1.0e6, le=1.0e6)]  # m
Velocity = Annotated[float, Field(ge=-1.0e3, le=1.0e3)]  # m/s
Rate = Annotated[float, Field(ge=-1.0e3, le=1.0e3)]  # rad/s
Slope = Annotated[float, Field(ge=-math.pi / 2.0, le=math.pi / 2.0)]  # rad, of a beam; steeper is taken for degrees

# The path. On a circle beyond the largest one, an orbit's, the reference is rounded to more than 1e-9 m. At the slowest
# speed the case study's circle takes a day.
Radius = Annotated[float, Field(ge=1.0e-3, le=1.0e7)]  # m
Speed = Annotated[float, Field(ge=1.0e-3, le=100.0)]  # m/s
MoveTime = Annotated[float, Field(ge=0.01, le=1.0e6)]  # s, of a motion from rest to rest; its fifth power divides

# Time. No loop on a spacecraft is faster than the least period; longer than the largest is taken for milliseconds.
Period = Annotated[float, Field(ge=1.0e-6, le=0.1)]  # s
EpisodeLength = Annotated[float, Field(ge=1.0e-6, le=1.0e7)]  # s, from the least control period to four months

# Control. The ends of the gains are those that some allowed control period can run: Kd < 2 / T, Kp < 2 Kd / T.
PositionGain = Annotated[float, Field(ge=1.0e-9, le=1.0e12)]  # 1/s2
RateGain = Annotated[float, Field(ge=1.0e-9, le=2.0e6)]  # 1/s
IntegralGain = Annotated[float, Field(ge=0.0, le=1.0e18)]  # 1/s3, below Kp Kd
NoiseLevel = Annotated[float, Field(ge=1.0e-12, le=1.0e6)]  # m, rad, their rates and accelerations
Damping = Annotated[float, Field(ge=0.0, le=1.0e9)]  # N s/m, N m s/rad, and what adapts them; sampled loops bear less
Decay = Annotated[float, Field(ge=0.0, le=1.0e6)]  # 1/s, as fast as the least control period
FilterRate = Annotated[float, Field(ge=1.0e-9, le=1.0e6)]  # 1/s, likewise

# The task. An observation has digits enough for its range and the scale of the reward at once.
Share = Annotated[float, Field(ge=1.0e-9, le=1.0)]  # part of a whole; more than that is taken for per cent
Sine = Annotated[float, Field(ge=1.0e-9, lt=1.0)]  # |sin| of an angle; no angle has more
Bound = Annotated[float, Field(ge=1.0e-9, le=1.0e6)]  # m, m/s, rad/s
AngleBound = Annotated[float, Field(ge=1.0e-9, le=2.0 * math.pi)]  # rad; more than a turn is taken for degrees
Weight = Annotated[float, Field(ge=0.0, le=1.0e6)]  # 1/s
Scale = Annotated[float, Field(ge=1.0e-12, le=1.0e12)]  # m, J, V; its square divides


def at_most(count: int, why: str) -> AfterValidator:
    """Return a check that a list has no more entries than some number, for the reason ``why``."""

    def check(entries: tuple[Any, ...]) -> tuple[Any, ...]:
        if len(entries) > count:
            raise check_error(f"must have at most {count} entries, has {len(entries)}: {why}")
        return entries

    return AfterValidator(check)


def _printable(lines: bool) -> Callable[[str], str]:
    """Return a check that a text shows as it is wherever it is shown."""

    def check(text: str) -> str:
        if not (text.replace("\n", "") if lines else text).isprintable():
            raise check_error("must consist of characters that can be printed")
        return text

    return check


Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_printable(lines=False))]
Text = Annotated[str, Field(max_length=LONGEST_TEXT), AfterValidator(_printable(lines=True))]

"""The section ``path`` of the parameters: the curve that the object is carried along, in time."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from sffr_gym.config.field_errors import error_at, raise_errors
from sffr_gym.config.ranges import Angle, MoveTime, Place, Radius, Speed, at_most
from sffr_gym.config.sections import Section
from sffr_gym.types import Array

DEGREE = 5  # of a piece's polynomials
N_PIECE = 1 + 3 * (DEGREE + 1)  # numbers of a piece: its start, and the coefficients of x, y and heading
MOST_POINTS = 64  # of a spline
RAMP = 0.25  # of a line's time, in which its speed rises or falls
LOBES = {"circle": 1.0, "figure-eight": 2.0}  # of closed paths

Kind = Literal["circle", "figure-eight", "line", "slew", "waypoints"]


class Path(Section):
    """The path of the object's centre from where it starts; each kind reads some of the keys and leaves the others."""

    kind: Kind = Field(description="its form [-]")
    radius: Radius = Field(description="circle: its radius; figure-eight: a quarter of its height, half its width [m]")
    speed: Speed = Field(
        description="circle: along it; figure-eight: at the start; waypoints: from point to point [m/s]"
    )
    heading: Literal["fixed", "tangent"] = Field(
        description="whether base and object turn with a circle, a figure-eight or waypoints [-]"
    )
    displacement: tuple[Place, Place] = Field(description="line, slew: from start to end along x and y [m]")
    turn: Angle = Field(description="slew: by which base and object turn [rad]")
    time: MoveTime = Field(description="line, slew: from rest at the start to rest at the end [s]")
    points: Annotated[tuple[tuple[Place, Place], ...], at_most(MOST_POINTS, "more make a step slow")] = Field(
        min_length=1, description="waypoints: places after the start, seen from it, along x and y [m]"
    )

    @property
    def closed(self) -> bool:
        """Whether the path leads back to its start, and goes on from there."""
        return self.kind in LOBES

    @property
    def arrival(self) -> float | None:
        """Time at which robot and object are at rest at the end [s]; None where they go on moving."""
        return self.time if self.kind in ("line", "slew") else None

    @property
    def period(self) -> float:
        """Length of an episode [s]: once along the path, and as long again where it ends at rest."""
        return 2.0 * self.time if self.arrival is not None else self.lap / self.speed

    @property
    def lap(self) -> float:
        """Speed times the time that it takes to go once along the path [m]; 0 where robot and object come to rest."""
        if self.closed:
            return 2.0 * math.pi * self.reach
        return 0.0 if self.arrival is not None else float(self._chords[-1])

    @property
    def reach(self) -> float:
        """Speed at the start of a closed path over the rate of the angle on it [m]."""
        return LOBES[self.kind] * self.radius

    @property
    def rate(self) -> float:
        """Rate of the angle on a closed path [rad/s]; 0 for others."""
        return self.speed / self.reach if self.closed else 0.0

    @property
    def acceleration(self) -> float:
        """The size of the path's acceleration, to which others are compared [m/s2]."""
        if self.closed or self.kind == "waypoints":
            return self.speed**2 / self.radius
        return max(math.hypot(*self.displacement), self.radius * abs(self.turn)) / self.time**2

    @property
    def acceleration_rate(self) -> float:
        """Likewise, of its rate [m/s3]."""
        if self.closed or self.kind == "waypoints":
            return self.speed**3 / self.radius**2
        return self.acceleration / self.time

    @property
    def start(self) -> tuple[float, float, float]:
        """Velocity and turn at the start [m/s, m/s, rad/s]; turning about the object's centre."""
        if self.closed:
            return self.speed, 0.0, self.speed / self.reach if self.heading == "tangent" else 0.0
        first = self.pieces[0, 1:].reshape(3, -1)
        turn = 0.0  # of a natural spline, which leaves along a straight line
        return float(first[0, 1]), float(first[1, 1]), turn

    @property
    def pieces(self) -> Array:
        """Return a path of polynomials in time, piece by piece (n, ``N_PIECE``); none for a closed one.

        Of each piece its start [s] and, ascending in the time since, the coefficients of x [m], y [m] and heading
        [rad], seen from the start; the last piece has no end.
        """
        if self.kind == "line":
            return self._straight(*_trapezoid(self.time), turn=0.0)
        if self.kind == "slew":
            return self._straight(*_minimum_jerk(self.time), turn=self.turn)
        return self._spline() if self.kind == "waypoints" else np.zeros((0, N_PIECE))

    @property
    def _chords(self) -> Array:
        """Return the length of the polygon through the points up to each of them (n,) [m]."""
        return np.cumsum(np.hypot(*np.diff(np.array([(0.0, 0.0), *self.points]), axis=0).T))

    def _straight(self, starts: Array, shares: Array, turn: float) -> Array:
        """Return pieces (n, ``N_PIECE``) from rest to rest, of whose ways the polynomials are (n, ``DEGREE`` + 1)."""
        ends = np.array([*self.displacement, turn])
        return np.column_stack([starts, (ends[None, :, None] * shares[:, None, :]).reshape(len(starts), -1)])

    def _spline(self) -> Array:
        """Return the natural cubic spline through the points, and straight on from the last one.

        A chord takes its length over the speed. At both ends the second derivative vanishes, so that nothing jumps.
        """
        from scipy.interpolate import CubicSpline  # late: a third of the time that the package takes to be imported

        places = np.array([(0.0, 0.0), *self.points])
        knots = np.append(0.0, self._chords) / self.speed
        spline = CubicSpline(knots, places, bc_type="natural")
        pieces = np.zeros((len(knots), 3, DEGREE + 1))
        pieces[:-1, :2, :4] = spline.c[::-1].transpose(1, 2, 0)
        pieces[-1, :2, 0], pieces[-1, :2, 1] = places[-1], spline(knots[-1], 1)
        return np.column_stack([knots, pieces.reshape(len(knots), -1)])

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.heading == "tangent" and self.arrival is not None:
            reason = f"must be fixed: a {self.kind} begins and ends at rest, where a path has no direction"
            raise_errors([error_at(("heading",), self.heading, f"{reason}; a slew turns by path.turn")])
        chords = np.hypot(*np.diff(np.array([(0.0, 0.0), *self.points]), axis=0).T)
        for k in np.flatnonzero(chords < 1.0e-3 * chords.max(initial=1.0e-3)):
            before = f"points.{k - 1}" if k else "the start"
            raise_errors([error_at(("points", int(k)), self.points[k], f"must be another place than {before}")])
        return self


def _minimum_jerk(time: float) -> tuple[Array, Array]:
    """Return starts (2,) [s] and shares (2, ``DEGREE`` + 1) of the smoothest motion from rest to rest.

    ``10 s^3 - 15 s^4 + 6 s^5`` of the part ``s`` of its time.

    Source: T. Flash and N. Hogan, "The coordination of arm movements", 1985.
    """
    shares = np.zeros((2, DEGREE + 1))
    shares[0, 3:] = np.array([10.0, -15.0, 6.0]) / time ** np.arange(3.0, 6.0)
    shares[1, 0] = 1.0
    return np.array([0.0, time]), shares


def _trapezoid(time: float) -> tuple[Array, Array]:
    """Return starts (4,) [s] and shares (4, ``DEGREE`` + 1) of a motion whose speed rises, stays and falls.

    It rises as ``3 s^2 - 2 s^3`` and falls likewise, so that the acceleration has no jump.
    """
    ramp, speed = RAMP * time, 1.0 / ((1.0 - RAMP) * time)
    way = 0.5 * speed * ramp  # covered in a ramp
    rise = speed * np.array([0.0, 0.0, 0.0, 1.0 / ramp**2, -0.5 / ramp**3, 0.0])
    shares = np.array([rise, [way, speed, 0.0, 0.0, 0.0, 0.0], [1.0 - way, speed, *-rise[2:]], [1.0, *[0.0] * DEGREE]])
    return np.array([0.0, ramp, time - ramp, time]), shares

"""The section ``actuators`` of the parameters: what thrusters, joints and piezos give of what is asked of them."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from sffr_gym.config.field_errors import error_at, raise_errors
from sffr_gym.config.ranges import Limit, OnTime, Quantum, Share, TimeConstant, TriggerGain, at_most
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import check_error

MOST_SPANS = 64  # of an array

Spans = Annotated[
    tuple[tuple[float, float], ...], Field(min_length=1), at_most(MOST_SPANS, "each is a channel of every action")
]


class Piezo(Section):
    """The piezoelectric actuators of each panel."""

    array: Literal["generalized", "patches", "tip"] = Field(description="what the channels act on [-]")
    force: Limit = Field(description="force at full voltage: of a patch, on the axial, transverse coordinate [N]")
    moment: Limit = Field(description="moment at full voltage on the tip slope [N m]")
    voltage: Limit = Field(description="full voltage [V]")
    patches: Spans = Field(description="patch pairs near the root, each from and to, as parts of the length [-]")
    tip: Spans = Field(description="patch pairs at the tip, likewise [-]")

    @field_validator("patches", "tip")
    @classmethod
    def _check_spans(cls, spans: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        end = 0.0
        for start, stop in spans:
            if not end <= start < stop <= 1.0:
                raise check_error(
                    "must be spans [from, to] with 0 <= from < to <= 1, none beginning before the last one ends"
                )
            end = stop
        return spans


class Modulator(Section):
    """A pulse-width pulse-frequency modulator of thrusters that are on or off, one for each body axis."""

    gain: TriggerGain = Field(description="of the filter before the trigger [-]")
    time_constant: TimeConstant = Field(description="of that filter [s]")
    opens: Share = Field(description="filtered command at which a thruster opens, as a part of its force [-]")
    shuts: Share = Field(description="filtered command at which it shuts [-]")
    minimum_on_time: OnTime = Field(description="time that it stays open at least [s]")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.shuts >= self.opens:
            reason = f"must be less than opens = {self.opens:g}, or the trigger chatters"
            raise_errors([error_at(("shuts",), self.shuts, reason)])
        if self.gain <= self.opens:
            reason = f"must be more than opens = {self.opens:g}, or even the full command opens no thruster"
            raise_errors([error_at(("gain",), self.gain, reason)])
        return self


class Lag(Section):
    """Time constants with which actuators follow what is asked of them; 0 is at once."""

    piezo: TimeConstant = Field(description="of the piezos [s]")
    thruster: TimeConstant = Field(description="of the thrusters [s]")
    joint: TimeConstant = Field(description="of the joints [s]")


class Quantisation(Section):
    """Steps in which actuators can be commanded; 0 is any value."""

    piezo: Quantum = Field(description="of the piezos' voltage [V]")
    thruster_force: Quantum = Field(description="of the force on each body axis [N]")
    thruster_torque: Quantum = Field(description="of the torque on the base [N m]")
    joint: Quantum = Field(description="of the joints' torque [N m]")


class Actuators(Section):
    """The thrusters, the joints and the piezoelectric actuators: their limits, and how well they do what is asked."""

    thruster_force: Limit = Field(description="largest force on each body axis [N]")
    thruster_torque: Limit = Field(description="largest torque on the base [N m]")
    thrusters: Literal["continuous", "on-off", "none"] = Field(description="what the thrusters are [-]")
    modulator: Modulator = Field(description="of thrusters that are on or off")
    joint_torque: Limit = Field(description="largest torque of each joint [N m]")
    lag: Lag = Field(description="how actuators follow")
    quantisation: Quantisation = Field(description="in which steps they do")
    piezo: Piezo = Field(description="piezoelectric actuators")

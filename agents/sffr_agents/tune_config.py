"""Configurations of searches, ``configs/tune``: what is tuned, over which settings, with how many seeds."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from sffr_agents.config import TrainConfig, build_section, load_config
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import CHECK, ConfigError, find_config, read_mapping

Value = bool | int | float | str


class Dimension(Section):
    """A setting and the values that it may take: an interval, of whole numbers if its ends are, or choices."""

    key: str = Field(description="dotted key of the training's configuration")
    low: int | float | None = Field(default=None, description="smallest value")
    high: int | float | None = Field(default=None, description="largest value")
    log: bool = Field(default=False, description="equal chances for equal ratios")
    choices: tuple[Value, ...] | None = Field(default=None, min_length=1, description="values; lists as texts")

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        interval = self.low is not None and self.high is not None
        if interval == (self.choices is not None) or (self.low is None) != (self.high is None):
            raise PydanticCustomError(CHECK, "needs either low and high, or choices")
        if self.low is not None and self.high is not None:
            if self.low > self.high:
                raise PydanticCustomError(CHECK, "low must not exceed high")
            if self.log and self.low <= 0:
                raise PydanticCustomError(CHECK, "log needs a positive low")
        return self

    @property
    def whole(self) -> bool:
        """Say whether the interval is of whole numbers."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    @property
    def ends(self) -> tuple[Value, ...]:
        """Return the ends of the interval, or all choices."""
        return self.choices or tuple(each for each in (self.low, self.high) if each is not None)


class TuneConfig(Section):
    """A search for the best settings of a training."""

    train: str = Field(description="configuration that is tuned: a shipped name or a file")
    set: tuple[str, ...] = Field(default=(), description="assignments that all trials share, such as steps=800000")
    seeds: int = Field(default=3, ge=1, le=1000, description="trainings of each trial, with the seeds from 0 up")
    trials: int = Field(default=30, ge=1, le=100_000, description="trials in all")
    space: tuple[Dimension, ...] = Field(min_length=1, description="settings that are searched")

    def training(self, values: dict[str, Value]) -> TrainConfig:
        """Return the training of a trial; raises ConfigError for values that are not valid."""
        chosen = [f"{key}={value if isinstance(value, str) else json.dumps(value)}" for key, value in values.items()]
        return load_config(self.train, [*self.set, *chosen])


def load_tune(name: str | os.PathLike[str], overrides: Sequence[str] = ()) -> TuneConfig:
    """Read a search: a shipped one by its name, or a file, with assignments on top.

    Raises:
        ConfigError: for a file, a key or a value that is not valid, of the search or of the trainings within it.
    """
    file = find_config(name, folder="tune")
    read = build_section(TuneConfig, *read_mapping(file), overrides)
    trials = [{dimension.key: value} for dimension in read.space for value in dimension.ends]
    for values in ({}, *trials):
        try:
            read.training(values)
        except ConfigError as error:
            place = f"{file}: {'space' if values else 'train or set'}"
            raise ConfigError("\n".join(f"{place}: {line}" for line in str(error).splitlines())) from None
    return read

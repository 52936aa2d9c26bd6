"""Parameters of the robot, its task and its controllers: the root of the models and how it is loaded and changed.

The sections are those of ``configs/sffr.yaml``; ``sections.py`` has their models.
"""

import functools
import os
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Annotated, Any, Self

from pydantic import Field, model_validator
from pydantic_core import InitErrorDetails

from sffr_gym.config.actuator_sections import Actuators
from sffr_gym.config.field_errors import error_at, raise_errors
from sffr_gym.config.files import short_hash
from sffr_gym.config.path import Path
from sffr_gym.config.ranges import at_most
from sffr_gym.config.reading import read_text
from sffr_gym.config.sections import (
    COSTS,
    EACH,
    MOST_ARMS,
    Arm,
    Base,
    Control,
    Initial,
    Limits,
    Object,
    Panel,
    Reward,
    Section,
    Simulation,
    Suppression,
    tip_form,
)
from sffr_gym.config.strict_yaml import (
    SHIPPED,
    ConfigError,
    Where,
    apply_overrides,
    build,
    config_dir,
    find_config,
    merge,
    read_mapping,
)
from sffr_gym.config.yaml_text import MOST_YAML

__all__ = ["ConfigError", "Params", "load_params"]

FASTEST_DECAY = 2.0  # of constraint errors, times the step; the integrators are stable up to 2.7


class Params(Section):
    """Everything that describes a robot, its task and its controllers; immutable and hashable."""

    base: Base = Field(description="rigid base")
    arms: Annotated[tuple[Arm, ...], at_most(MOST_ARMS, COSTS)] = Field(
        description="arms, in the order of the joints in q"
    )
    panel: Panel = Field(description="flexible panels")
    object: Object | None = Field(description="carried object, or null for a free-flying robot")
    actuators: Actuators = Field(description="actuator limits")
    initial: Initial = Field(description="initial state")
    path: Path = Field(description="desired motion")
    control: Control = Field(description="task-space control")
    suppression: Suppression = Field(description="vibration suppression")
    simulation: Simulation = Field(description="numerical settings")
    limits: Limits = Field(description="ends of an episode and ranges of the observation")
    reward: Reward = Field(description="terms of the reward")

    @property
    def n_links(self) -> int:
        """Number of links, and of joints, of all the arms."""
        return sum(len(arm.links) for arm in self.arms)

    @property
    def n_panels(self) -> int:
        """Number of panels."""
        return len(self.panel.mounts)

    def with_overrides(self, *assignments: str) -> Self:
        """Return a new object with assignments such as "panel.EI=25" made in turn, then validated together.

        A number in a key is a position in a list: "arms.0.links.1.mass=3.3". Values are YAML, "initial.qf=[0, 0.1, 0]"
        or "object=null". As in a file, a mapping changes the keys that it holds and a list replaces the old one.

        A robot that starts along its path goes on doing so where the path changes, unless ``initial.qd`` is given.

        Raises:
            ConfigError: if an assignment is malformed, names an unknown key or leads to an invalid value.
        """
        changed = build(type(self), *apply_overrides(self.to_dict(), assignments))
        given = any(assignment.strip().startswith("initial.qd") for assignment in assignments)
        return changed if given else changed._started_as(self)

    def to_dict(self) -> dict[str, Any]:
        """Return plain mappings, lists, texts and numbers, as in the file."""
        return self.model_dump(mode="json")

    def hash(self) -> str:
        """Return the :func:`short_hash` of the values."""
        return short_hash(self.to_dict())

    @property
    def _starts_along_path(self) -> bool:
        """Whether the given rates are those of a robot that moves as one along a path of fixed heading."""
        x, y, turn = self.path.start
        return turn == 0.0 and self.initial.qd == (x, y, *[0.0] * (1 + self.n_links))

    def _started_as(self, before: Self) -> Self:
        """Return the same with a start along the path, wherever that leads, if ``before`` has one."""
        left = before._starts_along_path and not self._starts_along_path
        if not left or self.initial.qd != before.initial.qd:
            return self
        return self.model_copy(update={"initial": self.initial.model_copy(update={"qd": None})})

    @model_validator(mode="after")
    def _check(self) -> Self:
        named, grasped = self._name_errors(), self._grasp_errors()
        raise_errors([*named, *grasped, *self._initial_errors(), *self._path_errors(), *self._drift_errors()])
        return self

    def _name_errors(self) -> list[InitErrorDetails]:
        errors = []
        for key, owners in (("arms",), self.arms), (("panel", "mounts"), self.panel.mounts):
            names = [owner.name for owner in owners]
            for i, name in enumerate(names):
                if name in names[:i]:
                    errors.append(error_at((*key, i, "name"), name, "must be unique; an earlier entry has this name"))
        return errors

    def _grasp_errors(self) -> list[InitErrorDetails]:
        links = {arm.name: len(arm.links) for arm in self.arms}
        grasps = self.object.grasps if self.object else ()
        errors = []
        for i, grasp in enumerate(grasps):
            if grasp.arm not in links:
                reason = f"must be the name of an arm ({', '.join(links) or 'there is none'})"
            elif links[grasp.arm] < 2:
                reason = "must be an arm of at least 2 links"
            elif grasp.arm in [earlier.arm for earlier in grasps[:i]]:
                reason = "must be another arm than that of an earlier grasp"
            else:
                continue
            errors.append(error_at(("object", "grasps", i, "arm"), grasp.arm, reason))
        return errors

    def _initial_errors(self) -> list[InitErrorDetails]:
        errors = []
        for name, value in ("q", self.initial.q), ("qd", self.initial.qd):
            found = name == "q" and self.initial.reach is not None and value is not None and len(value) == 3
            if value is not None and len(value) != 3 + self.n_links and not found:
                reason = f"must have {3 + self.n_links} entries, 3 of the base and {self.n_links} of the joints"
                advice = "; give the first 3 and initial.reach to have the others found" if name == "q" else ""
                errors.append(error_at(("initial", name), value, f"{reason}, has {len(value)}{advice}"))
        for name, tips in ("qf", self.initial.qf), ("qfd", self.initial.qfd):
            if tip_form(tips) == EACH and len(tips) != self.n_panels:
                reason = f"must have 3 numbers for all the panels or {self.n_panels} lists of 3, one for each"
                errors.append(error_at(("initial", name), tips, f"{reason}; has {len(tips)} lists"))
        return errors

    def _path_errors(self) -> list[InitErrorDetails]:
        """Return errors of a path whose own motion leaves the range of the observation: every episode would end."""
        path, limits = self.path, self.limits
        errors: list[InitErrorDetails] = []
        if path.kind != "circle":
            return errors  # see task.episode.nominal, which knows their motion
        if path.speed > limits.velocity:
            reason = f"must be at most limits.velocity = {limits.velocity:g} [m/s], the range in which it is observed"
            errors.append(error_at(("path", "speed"), path.speed, reason))
        elif path.speed**2 > limits.velocity * path.radius:
            least = path.speed**2 / limits.velocity
            reason = (
                f"must be at least speed^2 / limits.velocity = {least:.3g} [m]: the path's acceleration is observed"
            )
            errors.append(error_at(("path", "radius"), path.radius, reason))
        elif path.heading == "tangent" and path.speed > limits.rate * path.radius:
            reason = f"must be at least speed / limits.rate = {path.speed / limits.rate:.3g} [m]: its turn is observed"
            errors.append(error_at(("path", "radius"), path.radius, reason))
        return errors

    def _drift_errors(self) -> list[InitErrorDetails]:
        """Return an error of a decay of constraint errors that is too fast for the steps that integrate it."""
        longest = min(self.simulation.max_step, self.control.period)
        if self.simulation.baumgarte * longest <= FASTEST_DECAY:
            return []
        reason = f"must be at most {FASTEST_DECAY / longest:.3g} [1/s] with steps of {longest:g} s, or the drift grows"
        return [error_at(("simulation", "baumgarte"), self.simulation.baumgarte, reason)]


def load_params(path: str | os.PathLike[str] | None = None) -> Params:
    """Return the parameters of the shipped case study, changed by the keys of a file.

    Args:
        path: a YAML file, or the name of a shipped one such as "sffr"; None stands for the case study as it is. The
            file need hold only what differs from the shipped ``sffr.yaml``: its mappings are laid over the shipped
            ones key by key, at every depth, and its lists (such as ``arms``) replace the shipped ones whole. With
            another path and no ``initial.qd`` the robot starts along that path.

    Raises:
        ConfigError: if a file cannot be read or anything in it is unknown, missing or out of range; the message names
            the file, the key, the value and what is allowed, one line for each error.
    """
    if isinstance(path, Mapping):
        raise ConfigError("load_params reads a file; a mapping is given to an environment or evaluate as params=")
    return change_shipped(*read_mapping(find_config(path))) if path is not None else _shipped()


def change_shipped(changes: dict[str, Any], where: Where) -> Params:
    """Return the shipped case study with a mapping laid over it as :func:`load_params` lays a file.

    Raises:
        ConfigError: for a key or a value that is not valid; ``where`` names its source.
    """
    shipped, _ = read_mapping(config_dir() / SHIPPED)
    changed = build(Params, merge(shipped, changes), where)
    if "path" not in changes or "qd" in changes.get("initial", {}):
        return changed
    return changed._started_as(_shipped())


def _shipped() -> Params:
    """Return the shipped case study; the same object, which nobody can change, as long as its file stays the same."""
    file = config_dir() / SHIPPED
    return _built(file, read_text(file, MOST_YAML))


@functools.lru_cache(maxsize=2)
def _built(file: FilePath, text: str) -> Params:
    """Return the parameters in a file that holds this text."""
    return build(Params, *read_mapping(file))

"""Parameters of the robot, its task and its controllers: the root of the models and how it is loaded and changed.

The sections are those of `configs/sffr.yaml`; `sections.py` has their models.
"""

import hashlib
import json
import os
from typing import Any, Self

from pydantic import Field, model_validator
from pydantic_core import InitErrorDetails

from sffr_gym import config
from sffr_gym.config import ConfigError, config_dir
from sffr_gym.sections import (
    EACH,
    Actuators,
    Arm,
    Base,
    Control,
    Grasp,
    Initial,
    Limits,
    Link,
    Object,
    Panel,
    PanelMount,
    Path,
    Piezo,
    Reward,
    RewardTerm,
    Section,
    Simulation,
    Suppression,
    fault,
    refuse,
    tip_form,
)

__all__ = [
    "Actuators",
    "Arm",
    "Base",
    "ConfigError",
    "Control",
    "Grasp",
    "Initial",
    "Limits",
    "Link",
    "Object",
    "Panel",
    "PanelMount",
    "Params",
    "Path",
    "Piezo",
    "Reward",
    "RewardTerm",
    "Simulation",
    "Suppression",
    "config_dir",
    "load_params",
]


class Params(Section):
    """Everything that describes a robot, its task and its controllers; immutable and hashable."""

    base: Base = Field(description="rigid base")
    arms: tuple[Arm, ...] = Field(description="arms, in the order of the joints in q")
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

        Raises ConfigError if an assignment is malformed, names an unknown key or leads to an invalid value.
        """
        data, where = config.apply_overrides(self.to_dict(), assignments)
        return config.build(type(self), data, where)

    def to_dict(self) -> dict[str, Any]:
        """Return plain mappings, lists, texts and numbers, as in the file."""
        return self.model_dump(mode="json")

    def hash(self) -> str:
        """Return the first 16 hexadecimal digits of the SHA-256 of the values in canonical JSON."""
        text = json.dumps(self.to_dict(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @model_validator(mode="after")
    def _check(self) -> Self:
        refuse([*self._name_faults(), *self._grasp_faults(), *self._initial_faults()])
        return self

    def _name_faults(self) -> list[InitErrorDetails]:
        faults = []
        for key, owners in (("arms",), self.arms), (("panel", "mounts"), self.panel.mounts):
            names = [owner.name for owner in owners]
            for i, name in enumerate(names):
                if name in names[:i]:
                    faults.append(fault((*key, i, "name"), name, "must be unique; an earlier entry has this name"))
        return faults

    def _grasp_faults(self) -> list[InitErrorDetails]:
        links = {arm.name: len(arm.links) for arm in self.arms}
        grasps = self.object.grasps if self.object else ()
        faults = []
        for i, grasp in enumerate(grasps):
            if grasp.arm not in links:
                reason = f"must be the name of an arm ({', '.join(links) or 'there is none'})"
            elif links[grasp.arm] < 2:
                reason = "must be an arm of at least 2 links"
            elif grasp.arm in [earlier.arm for earlier in grasps[:i]]:
                reason = "must be another arm than that of an earlier grasp"
            else:
                continue
            faults.append(fault(("object", "grasps", i, "arm"), grasp.arm, reason))
        return faults

    def _initial_faults(self) -> list[InitErrorDetails]:
        faults = []
        for name, value in ("q", self.initial.q), ("qd", self.initial.qd):
            if len(value) != 3 + self.n_links:
                reason = f"must have {3 + self.n_links} entries, 3 of the base and {self.n_links} of the joints"
                faults.append(fault(("initial", name), value, f"{reason}, has {len(value)}"))
        for name, tips in ("qf", self.initial.qf), ("qfd", self.initial.qfd):
            if tip_form(tips) == EACH and len(tips) != self.n_panels:
                reason = f"must have 3 numbers for all the panels or {self.n_panels} lists of 3, one for each"
                faults.append(fault(("initial", name), tips, f"{reason}; has {len(tips)} lists"))
        return faults


def load_params(path: str | os.PathLike[str] | None = None) -> Params:
    """Return the parameters of the shipped case study, changed by the keys of a file.

    `path` is a YAML file, or the name of a shipped one such as "sffr"; None stands for the case study as it is. The
    file need hold only what differs from the shipped `sffr.yaml`: its mappings are laid over the shipped ones key by
    key, at every depth, and its lists (such as `arms`) replace the shipped ones whole.

    Raises ConfigError if a file cannot be read or anything in it is unknown, missing or out of range; the message names
    the file, the key, the value and what is allowed, one line for each fault.
    """
    data, where = config.read_mapping(config_dir() / config.SHIPPED)
    if path is not None:
        changes, where = config.read_mapping(config.find_config(path))
        data = config.merge(data, changes)
    return config.build(Params, data, where)

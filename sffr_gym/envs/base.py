"""What the single and the vector environment have in common: settled attributes, scenario, spec and state."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from gymnasium.envs.registration import EnvSpec

from sffr_gym.config.notebook import Shown, card
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.config.template import contiguous
from sffr_gym.envs.arguments import ParamsLike, ScenarioLike, plain, resolve_robot, resolve_scenario
from sffr_gym.envs.batch import Stepper
from sffr_gym.envs.starts import check_starts
from sffr_gym.envs.state import check_form
from sffr_gym.task.episode import Nominal, nominal
from sffr_gym.task.scenario import Scenario
from sffr_gym.task.task_model import TaskModel, make_task_model, nominal_plant

_ANOTHER = "make another environment"
_ROBOT = f"its plant is drawn by a scenario's `plant`; for another robot {_ANOTHER} with `params` or `overrides`"
_DRAWN = "it is drawn at each reset from the scenario"
_MOVING = "set_state() puts the environment into another state"


class RobotEnvironment(Shown):
    """What an environment was built with can be read but not set, as it is read only once; its state can be both.

    Raises:
        AttributeError: by setting what is settled; the message says what to do instead.
    """

    SETTLED: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("params", "prior_task", "fields"), _ROBOT),
        **dict.fromkeys(("episode", "plant", "plant_task", "reference", "ticks"), _DRAWN),
        **dict.fromkeys(("time", "positions", "velocities"), _MOVING),
        **dict.fromkeys(("render_mode", "num_envs", "autoreset_mode"), f"{_ANOTHER} with it as an argument"),
        "scenario": "reset(options={'scenario': ...}) changes it, from that reset on",
        "np_random_seed": "reset(seed=...) seeds the environment",
    }
    _SAME: ClassVar[tuple[str, ...]] = ("params",)  # keys of a state whose values must be this environment's

    params: Params  #: the robot as the controllers believe it to be
    prior_task: TaskModel  #: the same, packed
    _nominal: Nominal
    _nominal_plant: TaskModel  #: the scenario's plant before anything is drawn
    _scenario: Scenario | None = None
    _spec: EnvSpec | None = None

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute, of the settled ones those that the constructor has not set yet."""
        instead = self.SETTLED.get(name)
        if instead and (name in self.__dict__ or isinstance(getattr(type(self), name, None), property)):
            raise AttributeError(
                f"{name} of {type(self).__name__} cannot be set, which would change nothing: {instead}"
            )
        super().__setattr__(name, value)

    @property
    def scenario(self) -> Scenario:
        """What episodes are drawn from; ``reset(options={"scenario": ...})`` changes it."""
        assert self._scenario is not None
        return self._scenario

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the scenario in words and the spaces as well."""
        spaces = {name: _size(getattr(self, name)) for name in ("observation_space", "action_space")}
        return card(type(self).__name__, self._told() | {"draws": self.scenario.description} | spaces)

    def _told(self) -> dict[str, object]:
        return {"scenario": self.scenario.name}

    @property
    def spec(self) -> EnvSpec | None:
        """How Gymnasium made the environment, its arguments as plain values: ``spec.to_json()`` can write them.

        Of a single one, ``spec.max_episode_steps`` is the length of the scenario's longest episode. It is None in the
        registry, since that depends on the scenario; the environment itself truncates.
        """
        return self._spec and replace(self._spec, max_episode_steps=self._spec.max_episode_steps or self._longest())

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else replace(spec, kwargs=plain(spec.kwargs))

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy has: all but the stepper, whose calls know where the arrays of this one lie."""
        return {name: value for name, value in self.__dict__.items() if name != "_stepper"}

    def get_state(self) -> dict[str, Any]:
        """Everything that the future depends on; a copy that :meth:`set_state` restores bit for bit."""
        return copy.deepcopy(self._kept())

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what :meth:`get_state` returned, of this environment or of another one with the same parameters.

        Scenario, plants and random numbers are a part of the state. What the constructor was given is not, and is not
        taken over: a state of other parameters is refused, since the controllers would go on believing in these.

        Raises:
            ValueError: for a state of other parameters or of another number of environments, or a damaged one; the
                environment then stays as it was.
        """
        check_form(state, self._form(), self._SAME)
        kept = contiguous(copy.deepcopy(dict(state)))
        kept["scenario"] = self._checked_scenario(kept["scenario"])
        self._put(kept, self._check(kept))

    def _kept(self) -> dict[str, Any]:
        """The parts of the state themselves."""
        return {"params": self._hash, "scenario": self.scenario}

    def _form(self) -> dict[str, Any]:
        """What a state must look like, None for what :meth:`_check` looks at."""
        return self._kept()

    def _check(self, kept: dict[str, Any]) -> Any:
        """Make sure that a state of the right form can be gone on from; raise ValueError otherwise.

        Returns:
            What :meth:`_put` needs beside the state.
        """
        raise NotImplementedError

    def _put(self, kept: dict[str, Any], checked: Any) -> None:
        """Make the parts of a checked state this environment's own."""
        raise NotImplementedError

    @cached_property
    def _stepper(self) -> Stepper:
        """What advances the batch; made when it is first needed, and anew for other arrays."""
        return self._make_stepper()

    def _make_stepper(self) -> Stepper:
        """Return what advances the batch."""
        raise NotImplementedError

    def _forget_stepper(self) -> None:
        """Let another stepper be made, for arrays that were replaced."""
        self.__dict__.pop("_stepper", None)

    @cached_property
    def _hash(self) -> str:
        """What tells parameters apart."""
        return self.params.hash()

    def _settle(self, scenario: ScenarioLike, params: ParamsLike, overrides: Sequence[str]) -> None:
        """Take robot, plant and scenario for good; raises ConfigError."""
        resolved = resolve_scenario(scenario)
        self.params = resolve_robot(resolved, params, overrides)
        self.prior_task = make_task_model(self.params)
        self._nominal = nominal(self.params, resolved)
        self.fields = self._nominal.fields
        self._nominal_plant = nominal_plant(self.prior_task, self._nominal)
        check_starts(self._distribution(resolved), self._nominal, self._nominal_plant)
        self._scenario = resolved

    def _checked_scenario(self, scenario: ScenarioLike) -> Scenario:
        """Return a scenario whose episodes this robot can begin; raises ConfigError."""
        resolved = resolve_scenario(scenario)
        if resolved == self._scenario:
            return resolved
        if (resolved.robot, resolved.plant.settings) != (self.scenario.robot, self.scenario.plant.settings):
            raise ConfigError(
                f"scenario {resolved.name}: has another robot or plant than '{self.scenario.name}', with which this "
                "environment was made; make another environment for it"
            )
        check_starts(self._distribution(resolved), self._nominal, self._nominal_plant)
        return resolved

    def _distribution(self, scenario: Scenario) -> Scenario:
        """What episodes are drawn from."""
        return scenario

    def _longest(self) -> int | None:
        """The number of steps of the longest episode; None if that is not told."""
        return None


def _size(space: Any) -> str:
    """Return a box's shape and type in a few characters."""
    return f"Box{space.shape} {np.dtype(space.dtype).name}"

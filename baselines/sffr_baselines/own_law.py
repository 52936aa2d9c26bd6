"""Control laws of your own: the class to derive from, and the policy that runs one in every command.

``sffr evaluate mine.py:MyLaw`` runs one as it runs the shipped ones; docs/control.md shows how.
"""

from __future__ import annotations

import copy
import time
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from math import isnan
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.spaces import REAL
from sffr_gym.physics.linearization import command_labels
from sffr_gym.physics.simulator import Simulator
from sffr_gym.task.observation import Field
from sffr_gym.types import Array

FAULTS = (Exception, SystemExit)  # of a law's code, none of which ends a command without a word
TRIALS = 20  # calls of a law before anything runs, of which the fastest counts


class UnfitError(ConfigError):
    """A policy that cannot control this robot; where several run, it is skipped with this reason."""


def describe_error(error: BaseException) -> str:
    """Return the kind of an error, and what it says if anything."""
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


class ControlLaw:
    """A control law of your own: derive from it, and run it as ``mine.py:MyLaw`` or ``package.module:MyLaw``.

    Arguments of ``__init__`` are given behind the name, ``mine.py:MyLaw,gain=2``, and are YAML values. Each episode has
    a law of its own, a shallow copy of the one that was designed: :meth:`reset` makes anew whatever an episode changes.
    With ``batch = True`` one law controls many episodes at once: ``obs`` is (n, n_o), actions are (n, n_u), and
    ``seed`` is the list of the episodes' seeds.

    A law raises :class:`UnfitError` for a robot that it cannot control.

    Attributes:
        params: what the law may believe of the robot; an episode's plant can be another one.
        simulator: the same as a simulator, for models, frequencies, ``linearize``.
        fields: layout of an observation: name, place, unit and bound of each part.
        limit: (n_u,) largest command of each actuator, in the order of an action, which is a command divided by it.
        period: control period [s].
    """

    batch: ClassVar[bool] = False

    params: Params
    simulator: Simulator
    fields: dict[str, Field]
    limit: Array
    period: float

    def design(self, params: Params, simulator: Simulator) -> None:
        """Prepare what all episodes of a robot share, such as gains; called once."""

    def reset(self, params: Params, simulator: Simulator, seed: Any) -> None:
        """Begin an episode; ``seed`` is its own, for whatever the law draws."""

    def __call__(self, obs: Array) -> ArrayLike:
        """Return the action (n_u,) in [-1, 1] for an observation (n_o,); what lies beyond is clipped."""
        raise NotImplementedError("define __call__(self, obs) in your class; it returns the action")

    def see(self, obs: Array, name: str) -> Array:
        """Return a part of an observation (..., n_o) by the name of its field."""
        return obs[..., self.fields[name].slice]

    def action(
        self, volts: ArrayLike | None = None, base: ArrayLike | None = None, joints: ArrayLike | None = None
    ) -> Array:
        """Return the action (..., n_u) of a command in physical units; what is left out is zero.

        Args:
            volts: (..., n_p, n_c) piezo voltages [V].
            base: (..., 3) thrust along the base axes [N, N, N m].
            joints: (..., n_l) torques [N m].
        """
        n_p, _, n_c = self.simulator.actuators.K_PZ.shape
        ends = n_p * n_c, n_p * n_c + 3
        parts = [np.asarray(part, dtype=np.float64) for part in (volts, base, joints) if part is not None]
        given = [] if volts is None else [parts[0].reshape(*parts[0].shape[:-2], -1)]
        flat = [*given, *parts[len(given) :]]
        command = np.zeros((*(flat[0].shape[:-1] if flat else ()), len(self.limit)))
        for part, value in zip((volts, base, joints), ((0, ends[0]), ends, (ends[1], len(self.limit))), strict=True):
            if part is not None:
                command[..., slice(*value)] = flat.pop(0)
        return command / self.limit


class OwnPolicy:
    """A :class:`ControlLaw` as every command runs it: checked, with errors that say file and line.

    Args:
        name: what tables call it.
        law: as its class makes it.
        file: where it is written.
        prior: what it believes of the robot.

    Attributes:
        file: where the law is written.
        call_time: of one call [s], the fastest of some.

    Raises:
        ConfigError: if the law fails on the first observation of an episode, or returns no action; with file and line.
        UnfitError: if it cannot control the robot.
    """

    def __init__(self, name: str, law: ControlLaw, file: Path, prior: Params) -> None:
        self.name, self.file = name, file
        self._law, self._prior, self._laws = law, prior, [law]
        law.params, law.simulator = prior, Simulator(prior)
        law.period, law.limit = prior.control.period, law.simulator.actuators.rated
        env = SFFRFlexEnv(params=prior)
        law.fields = env.fields
        self._actuators = [each.name for each in command_labels(prior, law.simulator.model, law.simulator.actuators)]
        self._n_u = len(self._actuators)
        self._guarded("design", lambda: law.design(prior, law.simulator))
        obs, _ = env.reset(seed=0)
        self.call_time = self._try(obs)

    @property
    def batch(self) -> bool:
        """Whether the law controls many episodes in one call."""
        return self._law.batch

    def reset(self, seed: int | None = None) -> None:
        """Begin an episode."""
        self.begin([0 if seed is None else seed])

    def begin(self, seeds: Sequence[int]) -> None:
        """Begin an episode for each seed, all of them in one call from now on."""
        count = 1 if self.batch else len(seeds)
        self._laws = [copy.copy(self._law) for _ in range(count)]
        for k, law in enumerate(self._laws):
            seed = list(seeds) if self.batch else seeds[k]
            self._guarded("reset", partial(law.reset, self._prior, law.simulator, seed))

    def __call__(self, obs: Array) -> Array:
        """Return the actions for one observation or a batch of them; see :class:`policies.Policy`.

        Raises:
            ConfigError: for what is no action, or an error of the law, with file and line.
        """
        rows = obs[None] if obs.ndim == 1 else obs
        if self._law.batch:
            actions = self._action(self._laws[0], rows).astype(np.float64, copy=False)
        elif len(rows) == len(self._laws):
            actions = np.empty((len(rows), self._n_u))
            for k, law in enumerate(self._laws):
                actions[k] = self._action(law, rows[k])
        else:
            raise ValueError(f"observations of {len(self._laws)} episodes expected, got {len(rows)}; call begin")
        if isnan(np.vdot(actions, actions)):  # the fastest way to look for one
            names = [self._actuators[k] for k in np.flatnonzero(np.isnan(actions).any(axis=0))]
            raise ConfigError(f"{self._place()} returned NaN for {', '.join(names[:4])}")
        return actions[0] if obs.ndim == 1 else actions

    def _action(self, law: ControlLaw, obs: Array) -> Array:
        """Return a law's action, checked for all but NaN."""
        try:
            returned = law(obs)
        except FAULTS as error:
            raise self._located("__call__", error) from error
        try:
            action = np.asarray(returned)
        except Exception as error:  # of lists of different lengths, of a tensor that wants gradients
            raise ConfigError(f"{self._no_numbers(returned)}: {error}") from None
        if action.dtype.kind not in REAL or isinstance(returned, np.ma.MaskedArray):
            raise ConfigError(self._no_numbers(returned))
        shape = (*obs.shape[:-1], self._n_u)
        if action.shape != shape:
            raise ConfigError(f"{self._place()} returned an action of shape {action.shape}; it must be {shape}")
        return action

    def _no_numbers(self, returned: Any) -> str:
        return f"{self._place()} returned {returned!r:.60}, which is no array of real numbers"

    def _try(self, obs: Array) -> float:
        """Call the law a few times at the start of an episode, and return how long a call takes [s]."""
        taken = []
        self.begin([0])
        for _ in range(TRIALS):
            begun = time.perf_counter()
            self(obs)
            taken.append(time.perf_counter() - begun)
        return min(taken)

    def _guarded(self, method: str, call: Callable[[], Any]) -> None:
        try:
            call()
        except UnfitError as error:
            raise UnfitError(f"{self.name}: {error}") from None
        except FAULTS as error:
            raise self._located(method, error) from error

    def _located(self, method: str, error: BaseException) -> ConfigError:
        """Return the error with the last line of the law's own file that led to it."""
        if isinstance(error, UnfitError):
            return UnfitError(f"{self.name}: {error}")
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if Path(frame.filename) == self.file.absolute()]
        return ConfigError(f"{self._place(method, own[-1].lineno if own else None)}: {describe_error(error)}")

    def _place(self, method: str = "__call__", line: int | None = None) -> str:
        """Return file, a line of a method, its first one if left out, and what the method is called."""
        code = getattr(getattr(type(self._law), method), "__code__", None)
        line = code.co_firstlineno if line is None and code else line
        return f"{self.file}{'' if line is None else f':{line}'}: {type(self._law).__name__}.{method}"

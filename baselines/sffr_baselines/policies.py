"""Policies by name: baselines, scheduled ones, and files. They act on the observation alone."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from sffr_baselines.adapted import BoxPolicy, policy_inside
from sffr_baselines.damping_env import DampingEnvironment
from sffr_baselines.laws import ORACLES, LawPolicy, OraclePolicy, make_law
from sffr_baselines.learned import SUFFIX, learned_file, load_schedule, shipped_policies
from sffr_baselines.loop_stability import warn_if_unstable
from sffr_baselines.own_files import make_own, own_file, own_name, own_title
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.config.suggestion import did_you_mean
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.model import pack
from sffr_gym.task.episode import nominal
from sffr_gym.task.plants import extreme_plants
from sffr_gym.types import Array

POLICIES = {  # every name, with what it is
    "none": "piezos off, multiple impedance control alone",
    "random": "uniform actions",
    "hsc": "hybrid suppression control: constant virtual damping",
    "ahsc": "adaptive hybrid suppression control, the printed law (Y = e)",
    "ahsc-filtered": "the same with the filtered output (Y = e_dot + psi e)",
    "hsc-tuned": "HSC with the best constant damping that an optimiser found, see configs/policies",
    "lqr": "not of the paper: optimal active feedback of the panels about their quasi-static shape",
    "ahsc-ff": "AHSC that tracks: the panels' reaction fed forward, errors integrated, late sensors made up for",
    "lqr-ff": "lqr that tracks, likewise",
    "lqr-kf": "the same with its errors estimated by a Kalman filter, for noise",
    "mpc": "lqr-ff that knows the limits of its piezos: model predictive control, see predictive",
    "ppf": "positive position feedback: a filter for each mode of the panels, driven by displacements alone",
    "ppf-ff": "the same that tracks as lqr-ff does",
    "shaped": "piezos off, a motion from rest to rest shaped (ZVD) so that the panels end at rest",
    "shaped-zv": "the same with the shorter ZV shaper",
    "hsc-oracle": "HSC told each episode's plant, for what a right model gives",
    "ahsc-oracle": "AHSC told each episode's plant",
} | dict.fromkeys(shipped_policies(), "a law whose damping or feedback a network schedules, see docs/agents.md")


class Policy(Protocol):
    """Anything that turns observations into actions.

    Attributes:
        name: what tables call it.
    """

    name: str

    def reset(self, seed: int | None = None) -> None:
        """Forget the last episode; ``seed`` fixes what the policy itself draws."""

    def __call__(self, obs: Array) -> Array:
        """Return the actions (n_u,) for an observation (n_o,), or (n, n_u) for (n, n_o) of as many environments."""


class RandomPolicy:
    """Uniform actions over the whole range.

    Args:
        n_actions: length of an action.
    """

    name = "random"

    def __init__(self, n_actions: int) -> None:
        self._n_actions = n_actions
        self._rng = np.random.default_rng()

    def reset(self, seed: int | None = None) -> None:
        """Start a new stream of random numbers."""
        self._rng = np.random.default_rng(seed)

    def __call__(self, obs: Array) -> Array:
        """Draw actions; see :class:`Policy`."""
        return self._rng.uniform(-1.0, 1.0, (*np.shape(obs)[:-1], self._n_actions))


def make_policy(name: str | os.PathLike[str], env: Any, dtype: str = "float64") -> Policy:
    """Build a policy for ``SFFRFlex-v0``, or for ``SFFRFlexDamping-v0`` a schedule of its law's damping.

    Args:
        name: a key of :data:`POLICIES`, the path of a learned policy's ``.npz`` file, or a law of your own as
            ``mine.py:MyLaw``; see :class:`own_law.ControlLaw`.
        env: environment, single or vector, wrapped or not, or ``Params``: what the controller believes of the robot. In
            ``SFFRFlexDamping-v0`` a policy is a learned schedule, ``random``, or the law inside, which is action 0.
        dtype: of the actions: ``float64`` as they are commanded, also beyond the limits; or ``float32`` to have them
            rounded and clipped into the environment's action space, as tools that check it demand.

    Raises:
        ConfigError: for an unknown name (with the nearest one), or a file that cannot be read or is no policy for this
            robot; an :class:`own_law.UnfitError` if it is one, but of another robot.
        ValueError: for another ``dtype``.

    Warns:
        UserWarning: if the law is unstable on the environment's plant; see :mod:`loop_stability`.
    """
    policy = _policy(os.fspath(name), env if isinstance(env, Params) else env.unwrapped)
    if dtype not in ("float32", "float64"):
        raise ValueError(f"dtype = {dtype!r}: must be float64 or float32")
    return BoxPolicy(policy) if dtype == "float32" else policy


def _policy(name: str, env: Any) -> Policy:
    """Build a policy for a bare environment, or for parameters; see :func:`make_policy`."""
    prior: Params = env if isinstance(env, Params) else env.params
    inside, own = isinstance(env, DampingEnvironment), own_name(name)
    if inside and name != "random" and (own or name in POLICIES or learned_file(name) is not None):
        return policy_inside(name, policy_title(name), env)
    if own is not None:
        return make_own(name, prior)
    if learned_file(name) is not None:
        learned = load_schedule(name).policy(prior, policy_title(name))
        warn_of_instability(learned, env)
        return learned
    if name not in POLICIES:
        known = f"{', '.join(POLICIES)}, an {SUFFIX} file, or a law of your own as mine.py:MyLaw"
        raise ConfigError(f"unknown policy {name!r}{did_you_mean(name, POLICIES)} (known: {known})")
    if name == "random":
        return RandomPolicy(len(env.action_names) if inside else len(pack_actuators(prior, pack(prior)).limit))
    policy = OraclePolicy(name, prior) if name in ORACLES.values() else LawPolicy(name, make_law(name, prior))
    warn_of_instability(policy, env)
    return policy


def names_policy(name: str) -> bool:
    """Return whether a text is written as a policy's name is, whether or not there is such a policy."""
    return name in POLICIES or name.endswith(SUFFIX) or own_name(name) is not None


def policy_title(name: str) -> str:
    """Return what tables call a policy: its name; of a file its folder's name and its own; of a law its class's."""
    if own := own_name(name):
        return own_title(own)
    return "/".join(Path(name).with_suffix("").parts[-2:]) if name.endswith(SUFFIX) else name


def policy_file(name: str) -> Path | None:
    """Return the file that decides what a policy does, of a learned one or a law of your own; None for the others.

    Raises:
        ConfigError: for a law whose file is not there.
    """
    own = own_name(name)
    return learned_file(name) if own is None else own_file(own)


def check_titles(names: Sequence[str]) -> None:
    """Make sure that tables can show the policies and tell them apart; raises ConfigError."""
    titles = [policy_title(name) for name in names]
    for name, title in zip(names, titles, strict=True):
        if not title.isprintable():
            raise ConfigError(f"policy {name!r}: its name must be text on one line; rename its file or folder")
        if names.count(name) > 1:
            raise ConfigError(f"policy {name!r} is given twice")
        if titles.count(title) > 1:
            raise ConfigError(f"two policies would be called {title!r}: rename one file or its folder")


def warn_of_instability(policy: Policy, env: Any) -> None:
    """Warn of a law that is unstable on a plant of an environment's scenario: before anything is drawn, or at its ends.

    Args:
        policy: of any kind; only laws can be judged.
        env: environment, single or vector, or ``Params`` for the robot that the law believes in.
    """
    if not isinstance(policy, LawPolicy) or isinstance(policy, OraclePolicy):  # that is told the plant
        return
    for where, plant in _plants(env):
        if warn_if_unstable(policy.name, policy.law, plant, where):
            return


def _plants(env: Any) -> Iterator[tuple[str, Params]]:
    """Yield plants on which a law can be judged, each with what to call it."""
    if isinstance(env, Params):
        yield "its own robot", env
        return
    scenario, known = env.unwrapped.scenario, nominal(env.unwrapped.params, env.unwrapped.scenario)
    yield f"the plant of scenario '{scenario.name}'", known.plant
    if scenario.draws_model:
        for plant in extreme_plants(scenario, known.plant):
            yield f"a plant that scenario '{scenario.name}' draws", plant

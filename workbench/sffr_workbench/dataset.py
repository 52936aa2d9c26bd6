"""Datasets of Minari: episodes of policies, with the environment, the policy and hashes of both."""

from __future__ import annotations

import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from sffr_baselines.learned import file_hash
from sffr_baselines.policies import Policy, check_titles, make_policy, policy_file, policy_title
from sffr_gym import ConfigError, Params, load_params
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.provenance import package_version
from sffr_gym.task.scenario import EpisodeRange, Scenario, load_scenario
from sffr_gym.task.status import failure_text
from sffr_workbench.common import Progress, file_name, ignore

NAMESPACE, VERSION = "sffr", 0
IDS = ("SFFRFlex-v0", "SFFRFlexDamping-v0")
ROOT = "MINARI_DATASETS_PATH"  # environment variable that tells Minari where datasets lie
LICENSE = "MIT"


@dataclass(frozen=True)
class DatasetPlan:
    """What is recorded; everything that can be told before anything runs is valid.

    Raises:
        ConfigError: for what cannot be run.
    """

    policies: tuple[str, ...]  #: names, or ``.npz`` files of learned ones; each gets a dataset of its own
    scenario: str  #: shipped name or file
    episodes: int
    seed: int  #: of the first episode; the next ones count up
    env_id: str = IDS[0]
    params: Params | None = None  #: the robot; None for the case study
    infos: bool = False  #: whether infos are kept too

    def __post_init__(self) -> None:
        """Check what was given."""
        if not self.policies:
            raise ConfigError("no policy given")
        if self.env_id not in IDS:
            raise ConfigError(f"environment {self.env_id!r}: must be one of {', '.join(IDS)}")
        check_titles(self.policies)
        check_arguments(EpisodeRange, episodes=self.episodes, seed=self.seed)
        env = self.make()
        for name in self.policies:
            make_policy(name, env)

    def make(self) -> gym.Env[Any, Any]:
        """Return the environment, whose spec makes it again on any machine: files are in it, not their places."""
        scenario: Any = self.scenario
        if not _is_shipped(self.scenario):
            scenario = load_scenario(self.scenario).model_dump(mode="json")
        known = self.params is None or self.params == load_params()
        robot: dict[str, Any] = {} if known else {"params": self.params}
        return gym.make(f"sffr_gym:{self.env_id}", dtype="float32", scenario=scenario, **robot)

    def identifier(self, policy: str) -> str:
        """Return Minari's name of a policy's dataset."""
        words = (self.env_id.partition("-")[0].lower(), load_scenario(self.scenario).name, policy_title(policy))
        env, scenario, title = (file_name(word).replace("%", "_").replace(".", "_") for word in words)
        return f"{NAMESPACE}/{env}/{scenario}-{title}-v{VERSION}"


def write_datasets(plan: DatasetPlan, folder: Path, overwrite: bool = False, progress: Progress = ignore) -> list[Path]:
    """Record a dataset of each policy below a folder, each whole or not at all.

    Args:
        plan: what to record.
        folder: what Minari calls the root of datasets, made if need be.
        overwrite: replace datasets of the same names.
        progress: called with the policy, the episodes done and all.

    Returns:
        The datasets' folders.

    Raises:
        ConfigError: if there is a dataset of the same name and it is not to be replaced.
    """
    folder = folder.absolute()
    places = {name: folder / plan.identifier(name) for name in plan.policies}
    for place in places.values():
        if place.exists() and not overwrite:
            raise ConfigError(f"{place}: is there already; add --overwrite to replace it, or choose another --out")
    env, total = plan.make(), plan.episodes * len(plan.policies)
    for k, (name, place) in enumerate(places.items()):
        policy = make_policy(name, env, dtype="float32")
        episodes = []
        for i in range(plan.episodes):
            progress(policy.name, k * plan.episodes + i, total)
            episodes.append(_episode(env, policy, plan.seed + i, i, plan.infos))
        _write(plan, env, name, episodes, folder, place)
    progress(policy_title(plan.policies[-1]), total, total)
    return list(places.values())


def _episode(env: gym.Env[Any, Any], policy: Policy, seed: int, number: int, infos: bool) -> tuple[Any, dict[str, Any]]:
    """Return Minari's buffer of an episode and what is told of it."""
    from minari.data_collector import EpisodeBuffer

    obs, info = env.reset(seed=seed)
    policy.reset(seed)
    if hasattr(policy, "set_plant"):  # an oracle
        policy.set_plant(env.unwrapped.plant)  # type: ignore[attr-defined]
    observations, actions, steps, told = [obs], [], [], [info]
    ended = False
    while not ended:
        action = policy(obs)
        obs, reward, terminated, truncated, info = env.step(action)
        observations.append(obs)
        actions.append(action)
        steps.append((float(reward), terminated, truncated))
        told.append(info)
        ended = terminated or truncated
    rewards, terminations, truncations = (np.array(column) for column in zip(*steps, strict=True))
    buffer = EpisodeBuffer(
        id=number, seed=seed, observations=np.array(observations), actions=np.array(actions), rewards=rewards,
        terminations=terminations, truncations=truncations, infos=_columns(told) if infos else None,
    )  # fmt: skip
    return buffer, {"seed": seed, "failure": failure_text(info["failure"])}


def _columns(infos: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Return infos of many steps as an array for each key."""
    return {key: np.array([info[key] for info in infos]) for key in infos[0]}


def _write(
    plan: DatasetPlan, env: gym.Env[Any, Any], name: str, episodes: list[tuple[Any, dict[str, Any]]],
    folder: Path, place: Path,
) -> None:  # fmt: skip
    """Write a dataset beside its place, and move it there."""
    import minari

    folder.mkdir(parents=True, exist_ok=True)
    scenario, params = load_scenario(plan.scenario), env.unwrapped.params  # type: ignore[attr-defined]
    with (
        tempfile.TemporaryDirectory(dir=folder, prefix=".part-") as part,
        _datasets_in(part),
        warnings.catch_warnings(action="ignore", category=UserWarning),  # of addresses that it would like
    ):
        dataset = minari.create_dataset_from_buffers(
            plan.identifier(name), [buffer for buffer, _ in episodes], env=env, algorithm_name=policy_title(name),
            author="sffr-gym", description=_description(plan, scenario, name),
            requirements=[f"sffr-gym=={package_version('sffr-gym')}"],
        )  # fmt: skip
        dataset.storage.update_metadata(_facts(plan, scenario, params, name))
        dataset.storage.update_episode_metadata([about for _, about in episodes], range(len(episodes)))
        if place.exists():
            shutil.rmtree(place)
        place.parent.mkdir(parents=True, exist_ok=True)
        for namespace in Path(part).glob("*/namespace_metadata.json"):
            shutil.copy(namespace, folder / namespace.parent.name)
        os.replace(Path(part) / plan.identifier(name), place)


def _facts(plan: DatasetPlan, scenario: Scenario, params: Params, name: str) -> dict[str, Any]:
    """Return what tells datasets apart: hashes of scenario, parameters and policy, version, licence."""
    file = policy_file(name)
    return {
        "policy": policy_title(name), "policy_hash": file_hash(file) if file else "", "scenario": scenario.name,
        "scenario_hash": scenario.hash(params), "config_hash": params.hash(), "first_seed": plan.seed,
        "sffr_gym_version": package_version("sffr-gym") or "", "license": LICENSE,
    }  # fmt: skip


def _description(plan: DatasetPlan, scenario: Scenario, name: str) -> str:
    return f"{plan.episodes} episodes of {policy_title(name)} in {plan.env_id}. {scenario.description}"


def _is_shipped(scenario: str) -> bool:
    """Say whether a scenario is found by its name wherever the package is installed."""
    return not (os.sep in scenario or scenario.endswith((".yaml", ".yml"))) or scenario.startswith("practice/")


@contextmanager
def _datasets_in(folder: str) -> Iterator[None]:
    """Let Minari write into a folder."""
    before = os.environ.get(ROOT)
    os.environ[ROOT] = folder
    try:
        yield
    finally:
        os.environ.pop(ROOT)
        if before is not None:
            os.environ[ROOT] = before

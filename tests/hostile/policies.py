"""Tampered policies: ``.npz`` files, and the zips of Stable-Baselines3 that ``sffr export`` reads."""

from __future__ import annotations

import io
import pickle
import zipfile
from pathlib import Path

import numpy as np
import torch
import yaml
from arrays import SENTINEL, Payload, changed_arrays, zipped
from command import sffr, write_scenario
from hypothesis import strategies as st
from small_training import small
from spoil import changed_bytes, changed_tree
from trial import REFUSED, WORKED, Trial, Violation, check_refusal

from sffr_agents.algorithms import make_model
from sffr_baselines.learned import load_schedule, shipped_policies
from sffr_baselines.policies import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv

PICKLES = ("policy.pth", "policy.optimizer.pth", "pytorch_variables.pth", "data", "more.pth")


@st.composite
def changed_zip(draw: st.DrawFn, content: bytes) -> tuple[bytes, str]:
    """Draw a tampered zip of Stable-Baselines3."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    way = draw(st.sampled_from(["members", "members", "members", "bytes", "pickle", "pickle"]))
    if way == "bytes":
        return draw(changed_bytes(content))
    if way == "pickle":
        name = draw(st.sampled_from(PICKLES))
        stream = io.BytesIO()
        torch.save({"policy": Payload()}, stream)
        members[name] = draw(st.sampled_from([stream.getvalue(), pickle.dumps(Payload())]))
        return zipped(list(members.items())), f"{name}: a pickle that runs code"
    tree, story = draw(changed_tree(members))
    return zipped([(name, made) for name, made in tree.items() if isinstance(made, bytes)]), story


class Policies:
    """Policies of others."""

    name = "policies"
    most_seconds, most_memory = 10.0, 1e9

    def make_exemplars(self, folder: Path) -> None:
        """Write a small model's zip, its configuration and a short scenario."""
        config = small("ppo")
        make_model(config, 0)[0].save(folder / "model.zip")
        (folder / "small.yaml").write_text(yaml.safe_dump(config.model_dump(mode="json")))
        write_scenario(folder, duration=0.1)

    def load(self, folder: Path) -> None:
        """Read the exemplars and run the shipped policies."""
        self._folder = folder
        self._zip = (folder / "model.zip").read_bytes()
        self._npz = [file.read_bytes() for file in shipped_policies().values()]
        self._env = SFFRFlexEnv(scenario=folder / "short.yaml")
        for name in shipped_policies():
            rollout(self._env, make_policy(name, self._env), seed=0)

    def trials(self) -> st.SearchStrategy[Trial]:
        """Draw a file."""
        arrays = st.sampled_from(self._npz).flatmap(
            lambda content: st.one_of(changed_arrays(content), changed_bytes(content))
        )
        npz = arrays.map(lambda made: Trial(f"npz: {made[1]}", "npz", {"hostile.npz": made[0]}))
        zips = changed_zip(self._zip).map(lambda made: Trial(f"zip: {made[1]}", "zip", {"hostile.zip": made[0]}))
        return st.one_of(npz, npz, npz, zips)

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Run an episode with it."""
        outcome = self._export(folder) if trial.target == "zip" else self._run(folder / "hostile.npz")
        if Path(SENTINEL).exists():
            Path(SENTINEL).unlink()
            raise Violation("code of the file was run")
        return outcome, {f"{trial.target} {outcome}": 1}

    def _export(self, folder: Path) -> str:
        source = folder / "hostile.zip"
        return sffr(
            "export", source, "--algo", self._folder / "small.yaml", "-o", folder / "out.npz", places=[str(source)]
        )

    def _run(self, file: Path) -> str:
        try:
            schedule = load_schedule(file)
            policy = make_policy(file, self._env)
        except ConfigError as error:
            check_refusal(str(error), [str(file), "trial/hostile"])
            return REFUSED
        actions, _ = schedule.predict(np.zeros(len(schedule.obs_names)))
        if not (np.abs(actions) <= 1.0).all():
            raise Violation(f"actions of {actions}")
        trajectory = rollout(self._env, policy, seed=0)
        if not np.isfinite(trajectory.p).all():
            raise Violation("an episode with states that are not finite")
        return WORKED

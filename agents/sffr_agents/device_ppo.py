"""PPO in one file that trains where its environments are: on a GPU no number leaves the device but what is printed.

An example for learners of one's own, ``python -m sffr_agents.device_ppo --help``; ``sffr train`` has the trainings
behind the shipped policies. Every panel is an agent of its own with the same network, as there, so that what is learned
can be written as a policy for ``sffr evaluate``.

Source: J. Schulman et al., "Proximal policy optimization algorithms", 2017.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import torch
from torch import Tensor, nn
from torch.distributions import Normal
from torch.utils.dlpack import from_dlpack

from sffr_baselines.learned import LearnedSchedule, Network, save_schedule
from sffr_baselines.schedule import N_FEATURES

HIDDEN = 64


@dataclass(frozen=True)
class Settings:
    """What a training is made of."""

    steps: int = 32  #: actions of each environment between two updates
    epochs: int = 4  #: times that these are learned from
    minibatches: int = 4
    rate: float = 3.0e-4  #: of Adam
    discount: float = 0.98
    trace: float = 0.95  #: lambda of the generalised advantage
    clip: float = 0.2  #: of the ratio of probabilities
    entropy: float = 0.0  #: weight of it
    value: float = 0.5  #: weight of the value's error
    norm: float = 0.5  #: largest norm of a gradient


class Agent(nn.Module):
    """Actor and critic of one panel."""

    def __init__(self, n_actions: int) -> None:
        super().__init__()
        self.actor, self.critic = _layers(n_actions), _layers(1)
        self.log_std = nn.Parameter(torch.full((n_actions,), -0.5))

    def distribution(self, obs: Tensor) -> Normal:
        """Return the distribution of actions (..., n_actions) for observations (..., N_FEATURES)."""
        return Normal(self.actor(obs), self.log_std.exp())

    def value(self, obs: Tensor) -> Tensor:
        """Return values (...) of observations (..., N_FEATURES)."""
        return self.critic(obs).squeeze(-1)


class Rollout(NamedTuple):
    """What environments did between two updates; all (steps, agents, ...)."""

    obs: Tensor
    actions: Tensor
    log_prob: Tensor
    advantage: Tensor
    value: Tensor
    counts: Tensor  #: 0 for a step that only resets, else 1


class Learner:
    """Trains an agent in vector environments ``SFFRFlexDamping-v0``, on the processor or on a GPU.

    Args:
        envs: with next-step autoreset.
        settings: of the training.
        seed: of the first episodes and of the network.

    Attributes:
        agent: what is trained, on the device of the observations.
    """

    def __init__(self, envs: Any, settings: Settings, seed: int = 0) -> None:
        torch.manual_seed(seed)
        self._envs, self._settings = envs, settings
        first, _ = envs.reset(seed=seed)
        self._obs = self._panels(first)
        n_p = self._obs.shape[0] // envs.num_envs
        self.agent = Agent(envs.single_action_space.shape[0] // n_p).to(self._obs.device)
        self._optimizer = torch.optim.Adam(self.agent.parameters(), lr=settings.rate)
        self._done = torch.zeros(len(self._obs), dtype=torch.bool, device=self._obs.device)
        self._n_p, self._scale = n_p, torch.ones((), device=self._obs.device)

    def update(self) -> dict[str, float]:
        """Collect a rollout, learn from it, and return its mean reward of an action and losses."""
        rollout, reward = self._collect()
        parts = [part.flatten(0, 1)[rollout.counts.flatten() > 0] for part in rollout[:-1]]
        size, losses = len(parts[0]) // self._settings.minibatches, torch.zeros(2, device=self._obs.device)
        for _ in range(self._settings.epochs):
            order = torch.randperm(len(parts[0]), device=self._obs.device)
            for k in range(self._settings.minibatches):
                losses = self._learn(*(part[order[k * size : (k + 1) * size]] for part in parts))
        policy, value = losses.tolist()
        return {"reward": float(reward), "policy_loss": policy, "value_loss": value}

    def _collect(self) -> tuple[Rollout, Tensor]:
        """Act in all environments, and judge the actions."""
        rows: list[tuple[Tensor, ...]] = []
        agent, gamma = self.agent, self._settings.discount
        with torch.no_grad():
            for _ in range(self._settings.steps):
                distribution = agent.distribution(self._obs)
                actions = distribution.sample()
                chosen = actions.clamp(-1.0, 1.0).reshape(self._envs.num_envs, -1)
                found = self._envs.step(chosen if chosen.is_cuda else chosen.numpy())
                obs, reward = self._panels(found[0]), self._each(found[1])
                terminated, truncated = self._each(found[2]), self._each(found[3])
                value = agent.value(torch.stack([self._obs, obs]))
                counts = (~self._done).float()
                log_prob = distribution.log_prob(actions).sum(-1)
                rows.append((self._obs, actions, log_prob, reward.float(), *value, terminated.float(), counts))
                self._obs, self._done = obs, terminated | truncated
                rows[-1] += (self._done.float(),)
        seen, acted, log_prob, reward, value, after, terminated, counts, done = map(
            torch.stack, zip(*rows, strict=True)
        )
        mean = (reward * counts).sum() / counts.sum()
        self._scale = 0.9 * self._scale + 0.1 * ((reward * counts) ** 2).mean().sqrt().clamp(min=1.0e-8)
        delta = reward / self._scale + gamma * after * (1.0 - terminated) - value
        advantage, ahead = torch.zeros_like(delta), torch.zeros_like(delta[0])
        for k in reversed(range(len(delta))):
            ahead = (delta[k] + gamma * self._settings.trace * (1.0 - done[k]) * ahead) * counts[k]
            advantage[k] = ahead
        return Rollout(seen, acted, log_prob, advantage, value, counts), mean

    def _learn(self, obs: Tensor, actions: Tensor, before: Tensor, advantage: Tensor, value: Tensor) -> Tensor:
        """Take a step of the optimiser on a minibatch; returns the losses of policy and value (2,)."""
        settings, distribution = self._settings, self.agent.distribution(obs)
        ratio = (distribution.log_prob(actions).sum(-1) - before).exp()
        gain = (advantage - advantage.mean()) / (advantage.std() + 1.0e-8)
        clipped = ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip)
        policy = -torch.min(ratio * gain, clipped * gain).mean()
        error = (self.agent.value(obs) - (value + advantage)).square().mean()
        loss = policy + settings.value * error - settings.entropy * distribution.entropy().sum(-1).mean()
        self._optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.agent.parameters(), settings.norm)
        self._optimizer.step()
        return torch.stack([policy, error]).detach()

    def _panels(self, obs: Any) -> Tensor:
        """Return observations of environments as those of their panels; a copy, since a GPU's are written anew."""
        return from_dlpack(obs).reshape(-1, N_FEATURES).clone().float()

    def _each(self, values: Any) -> Tensor:
        """Return what environments have in common for each of their panels."""
        return from_dlpack(values).repeat_interleave(self._n_p)

    def save(self, path: Path) -> None:
        """Write the actor as a policy for ``sffr evaluate``."""
        linear = [layer for layer in self.agent.actor if isinstance(layer, nn.Linear)]
        weights = tuple(layer.weight.detach().double().cpu().numpy() for layer in linear)
        biases = tuple(layer.bias.detach().double().cpu().numpy() for layer in linear)
        host = getattr(self._envs.unwrapped, "host", self._envs.unwrapped)
        network = Network(weights, biases, relu=False, squash=False)
        save_schedule(path, LearnedSchedule.of(network, host, {"algo": "device_ppo"}))


def _layers(outputs: int) -> nn.Sequential:
    """Two hidden layers, the last one small, so that training begins near the law itself."""
    last = nn.Linear(HIDDEN, outputs)
    nn.init.orthogonal_(last.weight, 0.01)
    nn.init.zeros_(last.bias)
    return nn.Sequential(nn.Linear(N_FEATURES, HIDDEN), nn.Tanh(), nn.Linear(HIDDEN, HIDDEN), nn.Tanh(), last)


def main() -> None:
    """Train as the command line says, and write the policy."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", choices=("cpu", "cuda"), default="cuda")
    parser.add_argument("--envs", type=int, default=16384, help="environments (default: %(default)s)")
    parser.add_argument("--updates", type=int, default=100, help="updates (default: %(default)s)")
    parser.add_argument("--scenario", default="excited", help="scenario (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("ppo.npz"), help="policy to write (default: %(default)s)")
    asked = parser.parse_args()
    envs = gym.make_vec(
        "SFFRFlexDamping-v0", num_envs=asked.envs, backend=asked.backend, scenario=asked.scenario,
        autoreset_mode=gym.vector.AutoresetMode.NEXT_STEP,
    )  # fmt: skip
    learner, begun = Learner(envs, Settings(), asked.seed), time.perf_counter()
    for k in range(asked.updates):
        shown = ", ".join(f"{name} {value:.4g}" for name, value in learner.update().items())
        print(f"update {k + 1}, {time.perf_counter() - begun:.1f} s: {shown}", flush=True)
    learner.save(asked.out)


if __name__ == "__main__":
    main()

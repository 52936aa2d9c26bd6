"""A plain PPO of Stable-Baselines3 on the raw ``SFFRFlex-v0``: what a learner makes of thrusters, joints and piezos.

``python -m sffr_agents.raw_ppo --steps 400000 --out runs/raw-ppo`` trains with the library's defaults, whatever they
are, and leaves a table and a picture of how returns and episodes grew. Extras ``agents`` and ``plot``.
"""

from __future__ import annotations

import csv
import io
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

from sffr_gym import ConfigError
from sffr_gym.config.files import check_target, write_whole
from sffr_gym.types import Array

ENVIRONMENTS = 8
TABLE, PICTURE = "returns.csv", "returns.png"
COLUMNS = ("steps", "return", "seconds")  # means of the last 100 episodes that ended
PERIOD = 2.0e-3  # s, of a step


class Returns(BaseCallback):
    """Keeps the means of the last 100 episodes whenever the policy is about to be improved."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[tuple[float, float, float]] = []

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        ended = self.model.ep_info_buffer or ()
        if ended:
            returns, lengths = (float(np.mean([episode[key] for episode in ended])) for key in ("r", "l"))
            self.rows.append((float(self.num_timesteps), returns, PERIOD * lengths))


def train_raw(steps: int, scenario: str = "nominal", seed: int = 0) -> Array:
    """Return the table (rows, 3) of a training of so many steps, in the order of ``COLUMNS``."""
    torch.set_num_threads(1)
    env = make_vec_env("sffr_gym:SFFRFlex-v0", n_envs=ENVIRONMENTS, seed=seed, env_kwargs={"scenario": scenario})
    kept = Returns()
    PPO("MlpPolicy", env, seed=seed, device="cpu").learn(steps, callback=kept)
    return np.array(kept.rows).reshape(-1, len(COLUMNS))


def draw(table: Array) -> bytes:
    """Return a picture (PNG) of returns and lengths of episodes over steps."""
    from matplotlib.figure import Figure  # of the extra `plot`

    figure, picture = Figure(figsize=(7.2, 2.8), layout="constrained"), io.BytesIO()
    for axes, column, label in zip(
        figure.subplots(1, 2), (1, 2), ("return of an episode", "length of an episode [s]"), strict=True
    ):
        axes.plot(1e-3 * table[:, 0], table[:, column], color="#0072B2")
        axes.set(xlabel="steps, thousands", ylabel=label, ylim=(0.0, None))
        axes.grid(color="#E6E6E6")
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(picture, format="png", dpi=120, metadata={"Software": None})
    return picture.getvalue()


def main(
    steps: Annotated[int, typer.Option(min=1, help="Steps of all environments together.")] = 400_000,
    out: Annotated[Path, typer.Option(help="Folder of table and picture.")] = Path("runs/raw-ppo"),
    scenario: Annotated[str, typer.Option(help="Scenario to learn on.")] = "nominal",
    seed: Annotated[int, typer.Option(min=0, help="Of weights and episodes.")] = 0,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace table and picture.")] = False,
) -> None:
    """Train a plain PPO on the raw environment, and show how its returns grow."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in (TABLE, PICTURE):
            check_target(out / name, overwrite)
        table = train_raw(steps, scenario, seed)
    except ConfigError as error:
        sys.exit(f"error: {error}")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([COLUMNS, *table.tolist()])
    write_whole(out / TABLE, text.getvalue().encode())
    write_whole(out / PICTURE, draw(table))
    first, last = table[0], table[-1]
    print(f"{out}: return {first[1]:.3g} -> {last[1]:.3g}, length {first[2]:.3g} s -> {last[2]:.3g} s")


if __name__ == "__main__":
    typer.run(main)

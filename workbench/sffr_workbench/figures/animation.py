"""Animations of one policy, or of two side by side in the same episode, as GIF or MP4."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from gymnasium.error import DependencyNotInstalled

from sffr_baselines.rollout import Trajectory, rollout
from sffr_baselines.suppression import TRANSVERSE
from sffr_gym import ConfigError
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.files import check_target, write_whole
from sffr_gym.envs.arguments import ParamsLike
from sffr_gym.envs.pictures import require_pillow
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.kinematics import tip_deflections
from sffr_gym.physics.model import pack
from sffr_gym.task.scenario import EVALUATION_SEED, EpisodeRange
from sffr_gym.task.signals import ERROR, VIBRATION
from sffr_gym.types import Array
from sffr_workbench.common import Progress, ignore, require
from sffr_workbench.evaluation import episode_progress, make_policies, recorded_signals
from sffr_workbench.figures.encoding import choose_codec, gif, mp4
from sffr_workbench.figures.style import policy_colours

if TYPE_CHECKING:
    from sffr_gym.render.renderer import Renderer, Snapshot, Style

FORMATS = {".gif": ("render", "PIL"), ".mp4": ("video", "PIL", "av")}  # the extra that brings what draws and writes it
MOST_PICTURES = 50_000  # some hours of drawing
MOST_PIXELS = 4e9  # of a GIF, a byte each, which are in memory together
MAX_POLICIES = 2  # beside each other
GAP = 4  # pixels between them
RATES = (1, 2, 4, 5, 10, 20, 25, 50)  # pictures a second whose time is a whole number of a GIF's hundredths
LIMITS = {"speed": (0.01, 1000.0), "fps": (1, 120), "size": (200, 2000), "exaggeration": (0.0, 1000.0)}
TITLES = {"none": "no suppression", "hsc": "HSC", "ahsc": "AHSC", "ahsc-filtered": "AHSC, filtered", "lqr": "LQR"}


@dataclass(frozen=True)
class MovieOptions:
    """How an episode becomes a moving picture."""

    speed: float = 4.0  #: times real time
    fps: int = 20  #: pictures a second
    duration: float | None = None  #: of the episode to show [s]; None for all of it
    size: int = 600  #: pixels of either side of a policy's picture
    exaggeration: float = 5.0  #: factor of the drawn deflections

    def check(self, out: Path, overwrite: bool) -> None:
        """Make sure, before anything runs, that a file can be made this way.

        Raises:
            ConfigError: if not; it says what would be right.
        """
        if out.suffix not in FORMATS:
            raise ConfigError(f"{out}: the name must end in {' or '.join(FORMATS)}")
        require(*FORMATS[out.suffix])
        try:
            require_pillow()
        except DependencyNotInstalled as error:
            raise ConfigError(str(error)) from None
        check_target(out, overwrite)
        if out.suffix == ".gif" and self.fps not in RATES:
            rates = ", ".join(map(str, RATES))
            raise ConfigError(
                f"fps = {self.fps}: a GIF counts in hundredths of a second, so one of {rates}; MP4 takes any"
            )
        for name, (low, high) in LIMITS.items():
            if not low <= (value := getattr(self, name)) <= high:
                shown = f"{value:g}" if isinstance(value, float) else value
                raise ConfigError(f"{name} = {shown}: must be from {low:g} to {high:g}")
        if self.duration is not None and not (self.duration > 0.0 and isfinite(self.duration)):
            raise ConfigError(f"duration = {self.duration:g}: must be more than 0 s; without it all of the episode")

    def count(self, longest: float) -> int:
        """Return the number of pictures of an episode of a length [s]."""
        end = longest if self.duration is None else min(self.duration, longest)
        return max(round(end * self.fps / self.speed), 1)

    def check_count(self, out: Path, longest: float, policies: int) -> None:
        """Make sure that an episode of a length [s] makes no more pictures than anyone waits for, or memory holds.

        Raises:
            ConfigError: for too many.
        """
        count, pixels = self.count(longest), self.size * (self.size * policies + GAP * (policies - 1))
        most = MOST_PICTURES if out.suffix == ".mp4" else min(MOST_PICTURES, int(MOST_PIXELS / pixels))
        if count > most:
            shown = longest if self.duration is None else min(self.duration, longest)
            smaller = "" if most == MOST_PICTURES else f", lower size = {self.size}, make an MP4"
            raise ConfigError(
                f"duration = {shown:g} s: makes {count:.2g} pictures, at most {most}: shorten it, raise speed = "
                f"{self.speed:g}{smaller}, or lower fps = {self.fps}"
            )


def animate(
    policies: Sequence[str],
    out: Path,
    scenario: str | os.PathLike[str] = "nominal",
    seed: int = EVALUATION_SEED,
    params: ParamsLike = None,
    overrides: Sequence[str] = (),
    options: MovieOptions = MovieOptions(),
    overwrite: bool = False,
    progress: Progress = ignore,
) -> list[Trajectory]:
    """Run policies in the same episode and write the moving picture.

    Args:
        policies: one or two.
        out: file to write, ``.gif`` or ``.mp4``.
        scenario: a shipped scenario's name or a file.
        seed: of the episode.
        params: a ``Params`` object, a file, or None for the case study; the robot as controllers know it.
        overrides: assignments such as ``"panel.EI=25"`` on top of them.
        options: how it is shown.
        overwrite: whether the file may be replaced.
        progress: called with what is being done, how much of it is done, and how much there is to do.

    Returns:
        The episodes.

    Raises:
        ConfigError: for anything that is not valid; nothing has run then.
    """
    options.check(out, overwrite)
    env = SFFRFlexEnv(scenario, params, overrides)
    runners = make_policies(policies, env.params)
    if len(runners) > MAX_POLICIES:
        raise ConfigError(f"{len(runners)} policies: at most {MAX_POLICIES} fit side by side")
    seed = check_arguments(EpisodeRange, seed=seed).seed
    progress(runners[0].name, 0, 0)
    trajectories = []
    env.reset(seed=seed)
    options.check_count(out, env.ticks * env.params.control.period, len(runners))
    width = len(runners) * (options.size + GAP) - GAP
    codec = choose_codec(options.size, width, options.fps) if out.suffix == ".mp4" else ""
    for runner in runners:
        progress(runner.name, 0, env.ticks)
        trajectories.append(rollout(env, runner, seed, episode_progress(progress, runner.name, 0, env.ticks)))
    movie = Movie(trajectories, options)
    out.parent.mkdir(parents=True, exist_ok=True)
    write = partial(mp4, codec=codec) if codec else gif
    write_whole(out, write(movie, options.fps, lambda k: progress("drawing", k, len(movie))))
    return trajectories


class Movie:
    """The pictures of trajectories side by side, in any order; its length is their number.

    Args:
        trajectories: of the same episode.
        options: how they are shown.
    """

    def __init__(self, trajectories: Sequence[Trajectory], options: MovieOptions) -> None:
        longest = max(trajectory.t[-1] for trajectory in trajectories)
        end = longest if options.duration is None else min(options.duration, longest)
        self._step = options.speed / options.fps  # s between two pictures
        self._count = options.count(longest)
        damped = any(np.nan_to_num(trajectory.B_hat[:, :, TRANSVERSE]).any() for trajectory in trajectories)
        self._snapshots = [Snapshots(trajectory, damped) for trajectory in trajectories]
        self._renderers = self._side_by_side(trajectories, options, end)

    def __len__(self) -> int:
        """Return the number of pictures."""
        return self._count

    def __iter__(self) -> Iterator[np.ndarray]:
        """Draw all pictures."""
        return (self[k] for k in range(self._count))

    def __getitem__(self, k: int) -> np.ndarray:
        """Draw picture ``k`` (height, width, 3), uint8."""
        t = k * self._step
        pictures = [
            renderer(snapshots(t)) for renderer, snapshots in zip(self._renderers, self._snapshots, strict=True)
        ]
        gap = np.full((len(pictures[0]), GAP, 3), 60, dtype=np.uint8)
        return np.hstack([part for picture in pictures for part in (gap, picture)][1:])

    def _side_by_side(self, trajectories: Sequence[Trajectory], options: MovieOptions, end: float) -> list[Renderer]:
        """Return what draws each, with the same ranges in their plots."""
        from sffr_gym.render.renderer import Renderer, Style  # Pillow is optional

        colours = policy_colours(trajectory.policy for trajectory in trajectories)

        def renderer(trajectory: Trajectory, style: Style) -> Renderer:
            title = TITLES.get(trajectory.policy, trajectory.policy)
            subtitle = f"{trajectory.scenario} · {options.speed:g}x real time"
            own = style._replace(colour=_brightened(colours[trajectory.policy]))
            return Renderer(trajectory.episode.plant, trajectory.reference, title, subtitle, own)

        style = Style(options.size, options.exaggeration, end)
        together = np.vstack([each.trace[each.trace[:, 0] <= end] for each in self._snapshots])
        plots = renderer(trajectories[0], style).plots(self._snapshots[0](0.0)._replace(trace=together))
        style = style._replace(axes={plot.title: plot.axis for plot in plots})
        return [renderer(trajectory, style) for trajectory in trajectories]


class Snapshots:
    """Snapshots of a trajectory at any time: straight lines between its recorded states; its end ever after.

    Args:
        trajectory: what happened.
        damped: whether the virtual damping belongs to what is plotted.

    Attributes:
        trace: (rows, columns) what pictures plot; see :mod:`sffr_gym.render.trace`.
    """

    def __init__(self, trajectory: Trajectory, damped: bool) -> None:
        self._trajectory = trajectory
        tips = tip_deflections(pack(trajectory.episode.plant), trajectory.p)
        columns = [trajectory.t, *recorded_signals(trajectory)[:, [ERROR, VIBRATION]].T, *tips.T]
        self.trace = np.column_stack([*columns, *(trajectory.B_hat[:, :, TRANSVERSE].T if damped else ())])

    def __call__(self, t: float) -> Snapshot:
        """Return the snapshot at a time [s]."""
        from sffr_gym.render.renderer import Snapshot  # Pillow is optional

        kept = self._trajectory
        t = min(t, float(kept.t[-1]))
        row = min(int(np.searchsorted(kept.t, t, side="right")), len(kept.t) - 1)
        before = max(row - 1, 0)
        share = (t - kept.t[before]) / (kept.t[row] - kept.t[before]) if row > before else 0.0

        def between(values: Array) -> Array:
            return (1.0 - share) * values[before] + share * values[row]

        trace = np.vstack([self.trace[: before + 1], between(self.trace)])
        failure = kept.failure if t >= kept.t[-1] else ""
        return Snapshot(t, between(kept.p), between(kept.v), between(kept.applied), trace, failure)


def _brightened(colour: str) -> tuple[int, int, int]:
    """Return a colour ``#rrggbb`` of the figures, brightened for a dark ground."""
    red, green, blue = (round(255 - 0.62 * (255 - int(colour[at : at + 2], 16))) for at in (1, 3, 5))
    return red, green, blue

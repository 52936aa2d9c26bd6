"""Moving pictures of one policy, or of two side by side in the same episode, as GIF or MP4."""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.evaluate import EVALUATION_SEED, counter, make_policies
from agents.figures import COLOURS
from agents.files import write_whole
from baselines.rollout import STRIDE, Trajectory, rollout
from baselines.suppression import TRANSVERSE
from sffr_gym import ConfigError
from sffr_gym.beam import Array
from sffr_gym.env import ParamsLike, SFFRFlexEnv, resolve_params
from sffr_gym.geometry import tip_deflections
from sffr_gym.model import pack
from sffr_gym.task import ERROR, VIBRATION

if TYPE_CHECKING:
    from sffr_gym.render import Look, Renderer, Snapshot

FORMATS = {".gif": ("PIL", "render"), ".mp4": ("av", "video")}  # what writes it, and the extra that brings that
MOST = 2  # policies beside each other
GAP = 4  # pixels between them
RATES = (1, 2, 4, 5, 10, 20, 25, 50)  # pictures a second whose time is a whole number of a GIF's hundredths
COLOURS_OF_A_GIF = 96
SAMPLES = 12  # pictures from which a GIF's colours are chosen
TITLES = {"none": "no suppression", "hsc": "HSC", "ahsc": "AHSC", "ahsc-filtered": "AHSC, filtered", "lqr": "LQR"}
OTHER_COLOUR = "#E69F00"

Report = Callable[[str, int, int], Any]  # what is being done, how much of it is, and how much there is


@dataclass(frozen=True)
class Cut:
    """How an episode becomes a moving picture.

    Attributes:
        speed: times real time.
        fps: pictures a second.
        duration: of the episode to show [s]; None for all of it.
        size: pixels of either side of a policy's picture.
        exaggeration: factor of the drawn deflections.
    """

    speed: float = 4.0
    fps: int = 20
    duration: float | None = None
    size: int = 600
    exaggeration: float = 5.0

    def check(self, out: Path, overwrite: bool) -> None:
        """Make sure, before anything runs, that a file can be made this way.

        Raises:
            ConfigError: if not; it says what would be right.
        """
        if out.suffix not in FORMATS:
            raise ConfigError(f"{out}: the name must end in {' or '.join(FORMATS)}")
        for module, extra in FORMATS[".gif"], FORMATS[out.suffix]:
            if find_spec(module) is None:
                raise ConfigError(f"not installed: {module}; pip install 'sffr-gym[{extra}]'")
        if out.exists() and not overwrite:
            raise ConfigError(f"{out}: is there already; choose another name with --out or add --overwrite")
        if out.suffix == ".gif" and self.fps not in RATES:
            rates = ", ".join(map(str, RATES))
            raise ConfigError(
                f"fps = {self.fps}: a GIF counts in hundredths of a second, so one of {rates}; MP4 takes any"
            )
        limits = {"speed": (0.01, 1000.0), "fps": (1, 120), "size": (200, 2000), "exaggeration": (0.0, 1000.0)}
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise ConfigError(f"{name} = {getattr(self, name):g}: must be from {low:g} to {high:g}")
        if self.duration is not None and not self.duration > 0.0:
            raise ConfigError(f"duration = {self.duration:g}: must be more than 0 s")


def animate(
    policies: Sequence[str],
    out: Path,
    scenario: str | os.PathLike[str] = "nominal",
    seed: int = EVALUATION_SEED,
    params: ParamsLike = None,
    overrides: Sequence[str] = (),
    cut: Cut | None = None,
    overwrite: bool = False,
    progress: Report | None = None,
) -> list[Trajectory]:
    """Run policies in the same episode and write the moving picture.

    Args:
        policies: one or two.
        out: file to write, ``.gif`` or ``.mp4``.
        scenario: a shipped scenario's name or a file.
        seed: of the episode.
        params: a ``Params`` object, a file, or None for the case study; the robot as controllers know it.
        overrides: assignments such as ``"panel.EI=25"`` on top of them.
        cut: how it is shown.
        overwrite: whether the file may be replaced.
        progress: called with what is being done, how much of it is done, and how much there is to do.

    Returns:
        The episodes.

    Raises:
        ConfigError: for anything that is not valid; nothing has run then.
    """
    cut, report = cut or Cut(), progress or (lambda what, done, total: None)
    cut.check(out, overwrite)
    resolved = resolve_params(params, list(overrides))
    runners = make_policies(policies, resolved)
    if len(runners) > MOST:
        raise ConfigError(f"{len(runners)} policies: at most {MOST} fit side by side")
    if seed < 0:
        raise ConfigError(f"seed = {seed}: must be at least 0")
    report(runners[0].name, 0, 0)  # what follows may have to compile
    env, trajectories = SFFRFlexEnv(scenario, resolved), []
    env.reset(seed=seed)
    for runner in runners:
        report(runner.name, 0, env.ticks)
        trajectories.append(rollout(env, runner, seed, counter(report, runner.name, 0, env.ticks)))
    movie = Movie(trajectories, cut)
    out.parent.mkdir(parents=True, exist_ok=True)
    write = {".gif": gif, ".mp4": mp4}[out.suffix]
    write_whole(out, write(movie, cut.fps, lambda k: report("drawing", k, len(movie))))
    return trajectories


class Movie:
    """The pictures of trajectories side by side, in any order; its length is their number.

    Args:
        trajectories: of the same episode.
        cut: how they are shown.
    """

    def __init__(self, trajectories: Sequence[Trajectory], cut: Cut) -> None:
        longest = max(trajectory.t[-1] for trajectory in trajectories)
        end = longest if cut.duration is None else min(cut.duration, longest)
        self._step = cut.speed / cut.fps  # s between two pictures
        self._count = max(round(end / self._step), 1)
        damped = any(np.nan_to_num(trajectory.B_hat[:, :, TRANSVERSE]).any() for trajectory in trajectories)
        self._reels = [Reel(trajectory, damped) for trajectory in trajectories]
        self._renderers = self._side_by_side(trajectories, cut, end)

    def __len__(self) -> int:
        """Number of pictures."""
        return self._count

    def __iter__(self) -> Iterator[np.ndarray]:
        """All pictures."""
        return (self[k] for k in range(self._count))

    def __getitem__(self, k: int) -> np.ndarray:
        """Picture ``k`` (height, width, 3), uint8."""
        t = k * self._step
        pictures = [renderer(reel(t)) for renderer, reel in zip(self._renderers, self._reels, strict=True)]
        gap = np.full((len(pictures[0]), GAP, 3), 60, dtype=np.uint8)
        return np.hstack([part for picture in pictures for part in (gap, picture)][1:])

    def _side_by_side(self, trajectories: Sequence[Trajectory], cut: Cut, end: float) -> list[Renderer]:
        """What draws each, with the same ranges in their plots."""
        from sffr_gym.render import Look, Renderer

        def renderer(trajectory: Trajectory, look: Look) -> Renderer:
            title = TITLES.get(trajectory.policy, trajectory.policy)
            subtitle = f"{trajectory.scenario}   {cut.speed:g}x real time"
            own = look._replace(colour=_colour(trajectory.policy))
            return Renderer(trajectory.episode.plant, trajectory.reference, title, subtitle, own)

        look = Look(cut.size, cut.exaggeration, end)
        together = np.vstack([reel.trace[reel.trace[:, 0] <= end] for reel in self._reels])
        plots = renderer(trajectories[0], look).plots(self._reels[0](0.0)._replace(trace=together))
        look = look._replace(axes={plot.title: plot.axis for plot in plots})
        return [renderer(trajectory, look) for trajectory in trajectories]


class Reel:
    """Snapshots of a trajectory at any time: straight lines between its recorded states; its end ever after.

    Args:
        trajectory: what happened.
        damped: whether the virtual damping belongs to what is plotted.

    Attributes:
        trace: (rows, columns) what pictures plot; see :mod:`sffr_gym.trace`.
    """

    def __init__(self, trajectory: Trajectory, damped: bool) -> None:
        self._trajectory = trajectory
        ticks = np.maximum(np.arange(len(trajectory.t)) * STRIDE - 1, 0)  # a signal is that of its period's end
        tips = tip_deflections(pack(trajectory.episode.plant), trajectory.p)
        columns = [trajectory.t, *trajectory.signals[ticks][:, [ERROR, VIBRATION]].T, *tips.T]
        self.trace = np.column_stack([*columns, *(trajectory.B_hat[:, :, TRANSVERSE].T if damped else ())])

    def __call__(self, t: float) -> Snapshot:
        """The snapshot at a time [s]."""
        from sffr_gym.render import Snapshot

        kept = self._trajectory
        t = min(t, float(kept.t[-1]))
        row = min(int(np.searchsorted(kept.t, t, side="right")), len(kept.t) - 1)
        before = max(row - 1, 0)
        share = (t - kept.t[before]) / (kept.t[row] - kept.t[before]) if row > before else 0.0

        def between(values: Array) -> Array:
            mixed: Array = (1.0 - share) * values[before] + share * values[row]
            return mixed

        trace = np.vstack([self.trace[: before + 1], between(self.trace)])
        failure = kept.failure if t >= kept.t[-1] else ""
        return Snapshot(t, between(kept.p), between(kept.v), between(kept.applied), trace, failure)


def gif(movie: Movie, fps: int, progress: Callable[[int], Any]) -> bytes:
    """The pictures as a GIF that repeats for ever, in colours chosen once for all of them."""
    from PIL import Image

    chosen = np.unique(np.linspace(0, len(movie) - 1, SAMPLES).round().astype(int))
    sample = Image.fromarray(np.vstack([movie[k] for k in chosen]))
    palette = sample.quantize(COLOURS_OF_A_GIF, Image.Quantize.MEDIANCUT)

    def pictures() -> Iterator[Image.Image]:
        for k, picture in enumerate(movie):
            progress(k)
            yield Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)

    each, file = pictures(), io.BytesIO()
    next(each).save(file, "GIF", save_all=True, append_images=each, duration=1000 // fps, loop=0, optimize=True)
    return file.getvalue()


def mp4(movie: Movie, fps: int, progress: Callable[[int], Any]) -> bytes:
    """The pictures as H.264 in an MP4 that browsers start to play while they load it."""
    import av

    height, width = (side // 2 * 2 for side in movie[0].shape[:2])  # the format wants even sides
    with tempfile.TemporaryDirectory() as folder:  # moving the index to the front takes a file
        file = Path(folder) / "movie.mp4"
        with av.open(str(file), "w", options={"movflags": "faststart"}) as container:
            stream = container.add_stream("libx264", rate=fps, options={"crf": "20"})
            stream.pix_fmt, stream.height, stream.width = "yuv420p", height, width
            for k, picture in enumerate(movie):
                progress(k)
                even = np.ascontiguousarray(picture[:height, :width])
                container.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
            container.mux(stream.encode())
        return file.read_bytes()


def _colour(policy: str) -> tuple[int, int, int]:
    """A policy's colour in the figures, brightened for a dark ground."""
    text = COLOURS.get(policy, OTHER_COLOUR)
    red, green, blue = (round(255 - 0.62 * (255 - int(text[at : at + 2], 16))) for at in (1, 3, 5))
    return red, green, blue

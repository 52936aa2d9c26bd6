"""`sffr animate`: what the files hold, and what is an error."""

import hashlib
import io
import sys

import numpy as np
import pytest
from command_line import sffr

from sffr_baselines.rollout import STRIDE
from sffr_gym import ConfigError
from sffr_gym.physics.kinematics import tip_deflections
from sffr_gym.physics.model import pack
from sffr_gym.task.signals import ERROR, VIBRATION
from sffr_workbench.common import extras
from sffr_workbench.figures import animation, encoding
from sffr_workbench.figures.animation import Movie, MovieOptions, Snapshots, animate

Image = pytest.importorskip("PIL.Image")

SCENARIO = """
name: short
description: A short episode with swinging panels.
duration: 2.0
panel_modes: [{mode: 1, amplitude: [0.2, 0.25]}]
"""
SMALL = MovieOptions(speed=1.0, fps=10, size=200)


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    file = tmp_path_factory.mktemp("scenario") / "short.yaml"
    file.write_text(SCENARIO)
    return str(file)


@pytest.fixture(scope="module")
def gif(scenario, tmp_path_factory):
    """A file of two policies, and their trajectories."""
    out = tmp_path_factory.mktemp("gif") / "both.gif"
    return out, animate(["none", "hsc"], out, scenario, options=SMALL)


def frames(file):
    """Pictures of a GIF and how long each is shown [ms]."""
    with Image.open(file) as image:
        pictures, times = [], []
        for k in range(image.n_frames):
            image.seek(k)
            pictures.append(np.asarray(image.convert("RGB")))
            times.append(image.info["duration"])
        return pictures, times


def test_gif_has_every_picture_in_its_size(gif):
    pictures, times = frames(gif[0])
    assert len(pictures) == 20 and set(times) == {100}
    assert {picture.shape for picture in pictures} == {(200, 2 * 200 + animation.GAP, 3)}
    with Image.open(gif[0]) as image:
        assert image.info["loop"] == 0


def test_gif_shows_the_movie(gif):
    """Its few colours are near to those drawn."""
    movie = Movie(gif[1], SMALL)
    pictures, _ = frames(gif[0])
    for k in (0, 11, 19):
        away = np.abs(pictures[k].astype(int) - movie[k].astype(int)).max(axis=-1)
        assert np.mean(away > 40) < 0.01 and np.median(away) < 8


def test_mp4_has_every_picture_in_its_size(scenario, tmp_path):
    av = pytest.importorskip("av")
    out = tmp_path / "both.mp4"
    trajectories = animate(["none", "hsc"], out, scenario, options=MovieOptions(speed=2.0, fps=24, size=201))
    movie = Movie(trajectories, MovieOptions(speed=2.0, fps=24, size=201))
    with av.open(str(out)) as container:
        (stream,) = container.streams.video
        assert stream.average_rate == 24
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(pictures) == len(movie) == round(trajectories[0].t[-1] / 2.0 * 24)
    assert pictures[0].shape == (200, 2 * 201 + animation.GAP, 3)
    away = np.abs(pictures[-1].astype(int) - movie[len(movie) - 1][:200].astype(int))
    assert away.mean() < 8.0


def test_same_command_writes_the_same_bytes(gif, scenario, tmp_path):
    again = tmp_path / "again.gif"
    animate(["none", "hsc"], again, scenario, options=SMALL)
    assert hashlib.sha256(again.read_bytes()).digest() == hashlib.sha256(gif[0].read_bytes()).digest()


def test_calm_side_swings_less(gif):
    """What an eye sees: how much of the view changes at the tips, left without suppression, right with it."""
    out = gif[0].with_name("long.gif")
    trajectories = animate(
        ["none", "hsc"], out, "excited", options=MovieOptions(speed=10.0, fps=5, duration=60.0, size=200)
    )
    movie = Movie(trajectories, MovieOptions(speed=10.0, fps=5, duration=60.0, size=200))
    late = np.stack([movie[k] for k in range(len(movie) - 6, len(movie))]).astype(int)
    tips = late[:, 24:40, :, :]  # upper panel's
    changes = np.abs(np.diff(tips, axis=0)).max(axis=-1) > 60
    left, right = changes[:, :, 60:140].sum(), changes[:, :, 264:344].sum()
    assert left > 2 * right


def test_snapshots_are_the_recorded_states_and_straight_lines_between(gif):
    trajectory = gif[1][0]
    snapshots = Snapshots(trajectory, damped=True)
    row = 7
    snapshot = snapshots(trajectory.t[row])
    np.testing.assert_allclose(snapshot.p, trajectory.p[row], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(snapshot.applied, trajectory.applied[row], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(snapshot.trace[-1], snapshots.trace[row], rtol=1e-12, atol=1e-15)
    middle = snapshots((trajectory.t[row] + trajectory.t[row + 1]) / 2)
    np.testing.assert_allclose(middle.p, trajectory.p[row : row + 2].mean(axis=0), rtol=1e-12, atol=1e-15)
    assert snapshots(0.0).trace.shape == (2, 7) and snapshots(1e9).t == trajectory.t[-1]


def test_trace_is_what_was_measured(gif):
    trajectory = gif[1][1]
    trace = Snapshots(trajectory, damped=True).trace
    ticks = np.arange(STRIDE, len(trajectory.signals), STRIDE) - 1
    np.testing.assert_array_equal(trace[1:, 1:3], trajectory.signals[ticks][:, [ERROR, VIBRATION]])
    tips = tip_deflections(pack(trajectory.episode.plant), trajectory.p)
    np.testing.assert_array_equal(trace[:, 3:5], tips)
    np.testing.assert_array_equal(trace[:, 5:], trajectory.B_hat[:, :, 1])
    assert Snapshots(trajectory, damped=False).trace.shape[1] == 5


def test_both_sides_have_the_same_axes(gif):
    movie = Movie(gif[1], SMALL)
    sides = [
        [plot.axis for plot in r.plots(snapshots(0.5))]
        for r, snapshots in zip(movie._renderers, movie._snapshots, strict=True)
    ]
    assert sides[0] == sides[1]
    largest = max(np.abs(snapshots.trace[:, 3:5]).max() for snapshots in movie._snapshots)
    assert largest <= sides[0][0].high < 5 * largest


def test_failure_is_shown_and_held_while_the_other_goes_on(scenario, tmp_path):
    trajectories = animate(
        ["random", "hsc"], tmp_path / "fail.gif", scenario, overrides=["limits.position=0.05"], options=SMALL
    )
    failed, whole = trajectories
    assert failed.failure and not whole.failure and failed.t[-1] < 0.8 * whole.t[-1]
    movie = Movie(trajectories, SMALL)
    assert len(movie) == 20
    last, before = movie[19], movie[18]
    np.testing.assert_array_equal(last[:, :200], before[:, :200])
    assert (last[:, 210:] != before[:, 210:]).any()
    snapshot = movie._snapshots[0](whole.t[-1])
    assert snapshot.failure == failed.failure and not movie._snapshots[0](0.0).failure


def test_one_policy_without_damping_plots_its_energy(scenario, tmp_path):
    trajectories = animate(["none"], tmp_path / "one.gif", scenario, options=SMALL)
    movie = Movie(trajectories, SMALL)
    assert movie[0].shape == (200, 200, 3)
    assert [plot.title for plot in movie._renderers[0].plots(movie._snapshots[0](0.5))][-1] == "vibration energy"


@pytest.mark.parametrize("options,count", [({"speed": 4.0}, 5), ({"duration": 1.0}, 10), ({"speed": 1000.0}, 1)])
def test_speed_and_duration_count_the_pictures(gif, options, count):
    assert len(Movie(gif[1], MovieOptions(**({"speed": 1.0, "fps": 10, "size": 200} | options)))) == count


def test_command_writes_and_says_what(scenario, tmp_path):
    out = tmp_path / "new" / "one.gif"
    arguments = ["hsc", "-s", scenario, "--size", 200, "--fps", 5, "--out", out]
    result = sffr("animate", *arguments)
    assert result.exit_code == 0, result.output
    assert len(frames(out)[0]) == 2
    assert "hsc: vibration energy" in result.stdout and "one.gif" in result.stdout and "MB" in result.stdout
    rejected = sffr("animate", *arguments)
    assert rejected.exit_code == 2 and "--overwrite" in rejected.output
    assert sffr("animate", *arguments, "--overwrite", "--quiet").stdout == ""
    assert sorted(file.name for file in out.parent.iterdir()) == ["one.gif"]


@pytest.mark.parametrize(
    "arguments,message",
    [
        (["hsd"], "did you mean 'hsc'"),
        (["hsc", "hsc"], "given twice"),
        (["none", "hsc", "ahsc"], "at most 2 fit side by side"),
        (["hsc", "-s", "nominl"], "did you mean 'nominal'"),
        (["hsc", "--out", "a.avi"], ".gif or .mp4"),
        (["hsc", "--fps", "30"], "one of 1, 2, 4, 5, 10, 20, 25, 50"),
        (["hsc", "--speed", "0"], "speed = 0: must be from"),
        (["hsc", "--size", "20"], "size = 20: must be from 200"),
        (["hsc", "--duration", "-1"], "duration = -1: must be more than 0 s"),
        (["hsc", "--seed", "-1"], "seed = -1"),
        (["hsc", "--set", "panel.mas=3"], "did you mean 'mass'"),
    ],
)
def test_errors_say_what_is_wrong(arguments, message, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    result = sffr("animate", *arguments)
    assert result.exit_code == 2 and message in result.output, result.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments,message",
    [
        ({"size": 0}, "size = 0: must be from 200 to 2000"),
        ({"size": -600}, "size = -600: must be from"),
        ({"size": 10**400}, "000: must be from 200 to 2000"),
        ({"fps": 0}, "fps = 0: must be from 1 to 120"),
        ({"fps": 10**9}, "fps = 1000000000: must be from"),
        ({"speed": float("nan")}, "speed = nan: must be from 0.01 to 1000"),
        ({"speed": -4.0}, "speed = -4: must be from"),
        ({"speed": float("inf")}, "speed = inf: must be from"),
        ({"exaggeration": 1e9}, "exaggeration = 1e+09: must be from 0 to 1000"),
        ({"exaggeration": float("nan")}, "exaggeration = nan: must be from"),
        ({"duration": float("nan")}, "duration = nan: must be more than 0 s"),
        ({"duration": float("inf")}, "duration = inf: must be more than 0 s; without it all of the episode"),
    ],
)
def test_options_have_ranges(arguments, message, tmp_path):
    with pytest.raises(ConfigError) as error:
        animate(["hsc"], tmp_path / "a.mp4", options=MovieOptions(**arguments))
    assert message in str(error.value)


@pytest.mark.parametrize(
    "name,options,message",
    [
        (
            "a.mp4",
            {"speed": 0.01, "fps": 120},
            r"makes 1.3e\+06 pictures, at most 50000: .* raise speed = 0.01, or lower",
        ),
        (
            "a.gif",
            {"speed": 0.2, "fps": 50, "size": 2000},
            r"at most 1000: .*, lower size = 2000, make an MP4, or lower",
        ),
    ],
)
def test_films_that_never_end_are_refused_before_anything_runs(name, options, message, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "rollout", lambda *_: pytest.fail("simulated"))
    with pytest.raises(ConfigError, match=message):
        animate(["hsc"], tmp_path / name, options=MovieOptions(**options))


def black(height=202, width=303, count=5):
    return [np.full((height, width, 3), 40 * k, dtype=np.uint8) for k in range(count)]


@pytest.mark.parametrize("codec", encoding.CODECS)
def test_every_encoder_that_is_there_writes_every_picture(codec):
    av = pytest.importorskip("av")
    if codec == "libopenh264" and codec not in av.codecs_available:
        pytest.skip("not in this FFmpeg")
    with av.open(io.BytesIO(encoding.mp4(black(), 25, lambda _: None, codec))) as container:
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert [picture.shape for picture in pictures] == [(202, 302, 3)] * 5
    np.testing.assert_allclose([picture.mean() for picture in pictures], [0, 40, 80, 120, 160], atol=4)


def without(monkeypatch, *codecs):
    """Take encoders out of PyAV."""
    av = pytest.importorskip("av")
    opened = av.open

    class Container:
        def __init__(self, *arguments, **options):
            self.real = opened(*arguments, **options)

        def __enter__(self):
            return self

        def __exit__(self, *error):
            self.real.close()

        def add_stream(self, codec, **options):
            if codec in codecs:
                raise av.codec.codec.UnknownCodecError(codec)
            return self.real.add_stream(codec, **options)

        def mux(self, packets):
            self.real.mux(packets)

    monkeypatch.setattr(av, "open", Container)


def test_another_encoder_is_taken_where_one_is_missing(monkeypatch):
    without(monkeypatch, "libx264")
    assert encoding.choose_codec(200, 200, 20) == "h264"
    monkeypatch.undo()
    without(monkeypatch, "libx264", "h264", "libopenh264")
    with pytest.warns(UserWarning, match=r"no encoder of H.264: browsers may not play"):
        assert encoding.choose_codec(200, 200, 20) == "mpeg4"


def test_no_encoder_is_an_error_before_anything_runs(monkeypatch, tmp_path):
    without(monkeypatch, *encoding.CODECS)
    monkeypatch.setattr(animation, "rollout", lambda *_: pytest.fail("simulated"))
    result = sffr("animate", "hsc", "--out", tmp_path / "a.mp4")
    assert result.exit_code == 2 and "no encoder of PyAV's FFmpeg makes an MP4 of 600 x 600 pixels" in result.output
    assert not list(tmp_path.iterdir())


def test_pyav_that_cannot_be_loaded_is_an_error(monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ConfigError, match="PyAV, which cannot be loaded"):
        encoding.choose_codec(200, 200, 20)


@pytest.mark.parametrize(
    "suffix,missing,extra", [(".gif", "PIL", "render"), (".mp4", "av", "video"), (".mp4", "PIL", "video")]
)
def test_missing_extra_says_what_to_install(monkeypatch, tmp_path, suffix, missing, extra):
    found = extras.find_spec
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == missing else found("sys"))
    with pytest.raises(ConfigError, match=rf"not installed: {missing}; pip install 'sffr-gym\[{extra}\]'"):
        animate(["hsc"], tmp_path / f"a{suffix}")


def test_help_has_defaults():
    text = sffr("animate", "--help").output
    assert "--speed" in text and "4.0" in text and "--exaggeration" in text and sys.executable not in text

"""Recordings: what a run folder keeps of an episode of each policy, read as it was written."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from report_runs import SEED, run

from sffr_baselines import make_policy
from sffr_baselines.rollout import STRIDE, rollout
from sffr_gym import ConfigError
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.reference import N_REFERENCE
from sffr_gym.task.scenario import Scenario
from sffr_workbench.evaluation import open_run
from sffr_workbench.evaluation.recording import Recording, grasp_forces, recording_files, recording_name
from sffr_workbench.report import read_run


@pytest.fixture(scope="module")
def trajectory():
    env = SFFRFlexEnv("excited")
    return rollout(env, make_policy("ahsc", env), SEED)


@pytest.fixture(scope="module")
def recording(trajectory):
    return Recording.of(trajectory)


def test_recording_is_read_as_it_was_written(recording, tmp_path):
    file = tmp_path / "ahsc.npz"
    file.write_bytes(recording.to_bytes())
    again = Recording.read(file)
    for name in ("policy", "scenario", "seed", "failure", "period", "plant"):
        assert getattr(again, name) == getattr(recording, name)
    for name in ("t", "p", "applied", "limit", "B_hat", "grasp", "signals", "tips"):
        np.testing.assert_allclose(getattr(again, name), getattr(recording, name), rtol=1e-6)
    np.testing.assert_array_equal(again.reference.joints, recording.reference.joints)
    assert again.reference[:N_REFERENCE] == recording.reference[:N_REFERENCE]


def test_recording_keeps_the_episode(trajectory, recording):
    ticks = np.arange(STRIDE, len(trajectory.signals), STRIDE) - 1
    np.testing.assert_array_equal(recording.signals[1:], trajectory.signals[ticks])
    np.testing.assert_array_equal(recording.p, trajectory.p)
    assert len(recording.tips) == len(trajectory.signals)
    assert recording_name("models/mine.zip") == "recordings/models%2Fmine.zip.npz"


def test_grasp_forces_of_any_policy(trajectory, recording):
    """Those that the compiled loop recorded are those that the simulator computes."""
    blind = trajectory.__class__(**vars(trajectory) | {"lam": np.full_like(trajectory.lam, np.nan)})
    np.testing.assert_allclose(grasp_forces(blind)[1:50], recording.grasp[1:50], rtol=1e-6, atol=1e-9)
    assert np.abs(recording.grasp).max() > 0.01


@pytest.mark.parametrize("change", ["object=null", "panel.mounts=[]"])
def test_a_robot_without_an_object_or_panels_is_recorded_too(change, tmp_path):
    env = SFFRFlexEnv(Scenario(name="short", description="a test's", duration=0.2), overrides=[change])
    recording = Recording.of(rollout(env, make_policy("none", env), SEED))
    (tmp_path / "none.npz").write_bytes(recording.to_bytes())
    np.testing.assert_allclose(Recording.read(tmp_path / "none.npz").p, recording.p, rtol=1e-6)


def test_a_recording_of_no_state_is_none(recording, tmp_path):
    rows = ("t", "p", "applied", "B_hat", "grasp", "signals")
    nothing = replace(recording, **{name: getattr(recording, name)[:0] for name in rows})
    (tmp_path / "none.npz").write_bytes(nothing.to_bytes())
    with pytest.raises(ConfigError, match="holds no state"):
        Recording.read(tmp_path / "none.npz")


@pytest.mark.parametrize(("value", "valid"), [(1.0e9, True), (1.001e9, False)])
def test_numbers_are_as_large_as_a_file_may_say(recording, tmp_path, value, valid):
    file = tmp_path / "far.npz"
    file.write_bytes(replace(recording, p=np.full_like(recording.p, value)).to_bytes())
    with nullcontext() if valid else pytest.raises(ConfigError, match=r"p must be finite, and at most 1e\+09"):
        assert Recording.read(file).p.max() == value


def test_run_folder_has_the_first_episode_of_each_policy(tmp_path):
    folder = tmp_path / "three"
    run(folder, ["none", "ahsc", "random"])
    read = {each.policy: each for each in map(Recording.read, recording_files(open_run(folder)))}
    assert read.keys() == {"none", "ahsc", "random"} and {each.seed for each in read.values()} == {SEED}
    assert [each.policy for each in read_run(folder).recordings] == ["none", "ahsc", "random"]
    assert np.isnan(read["random"].B_hat).all() and np.isfinite(read["random"].grasp).all()


def test_recordings_of_a_run_that_is_replaced_go(tmp_path):
    run(tmp_path / "run", ["none", "hsc"], episodes=1)
    run(tmp_path / "run", ["ahsc"], episodes=1)
    assert [file.name for file in recording_files(open_run(tmp_path / "run"))] == ["ahsc.npz"]


@pytest.mark.parametrize("damage", ["cut", "text", "shape", "plant", "pickle"])
def test_damaged_recording_is_an_error(recording, tmp_path, damage):
    file = tmp_path / "bad.npz"
    content = recording.to_bytes()
    match damage:
        case "cut":
            content = content[: len(content) // 2]
        case "text":
            content = b"no recording"
        case "shape":
            content = Recording(**vars(recording) | {"applied": recording.applied[:-1]}).to_bytes()
        case "plant":
            file.write_bytes(content)
            with np.load(file) as kept:
                arrays = dict(kept)
            arrays["about"] = np.array(str(arrays["about"]).replace('"elements": 1', '"elements": 0'))
            np.savez(file, **arrays)
            content = file.read_bytes()
        case "pickle":
            np.savez(file, about=np.array([{"a": 1}], dtype=object))
            content = file.read_bytes()
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=r"bad\.npz: (no recording|is no \.npz file of plain arrays), or"):
        Recording.read(file)


PIECES = ("t", "p", "applied", "limit", "B_hat", "grasp", "signals", "tips")


@pytest.mark.parametrize("name", PIECES)
def test_arrays_of_a_recording_fit_each_other_and_the_robot(recording, tmp_path, name):
    """One number too many or too few in any direction is refused, with the name of the array or of what it lacks."""
    array = getattr(recording, name)
    for axis in range(array.ndim):
        longer, shorter = (
            np.concatenate([array, array.take([0], axis)], axis),
            array.take(range(array.shape[axis] - 1), axis),
        )
        for other in (longer, shorter):
            if name == "tips" and axis == 0:
                continue  # its rows are control periods, and an episode may end in any
            file = tmp_path / "odd.npz"
            file.write_bytes(replace(recording, **{name: other}).to_bytes())
            with pytest.raises(ConfigError, match=r"odd\.npz: no recording, or damaged: \w+ has the shape"):
                Recording.read(file)


@pytest.mark.parametrize(("seed", "valid"), [(0, True), (2**40, True), (-1, False)])
def test_seeds_of_recordings_are_not_negative(recording, tmp_path, seed, valid):
    file = tmp_path / "seed.npz"
    file.write_bytes(replace(recording, seed=seed).to_bytes())
    with nullcontext() if valid else pytest.raises(ConfigError, match="seed"):
        assert Recording.read(file).seed == seed


def test_the_first_recorded_signals_are_those_of_the_first_period(trajectory, recording):
    """Before which nothing was measured."""
    np.testing.assert_array_equal(recording.signals[0], trajectory.signals[0])
    assert (trajectory.signals[0] != trajectory.signals[1]).any()


@pytest.mark.parametrize("mass", [0.5, 1.0])
def test_a_robot_with_a_light_object_is_recorded_with_it(tmp_path, mass):
    env = SFFRFlexEnv(Scenario(name="short", description="a test's", duration=0.2), overrides=[f"object.mass={mass}"])
    recording = Recording.of(rollout(env, make_policy("none", env), SEED))
    (tmp_path / "none.npz").write_bytes(recording.to_bytes())
    assert Recording.read(tmp_path / "none.npz").p.shape == recording.p.shape


def test_an_episode_of_one_state_is_recorded(recording, tmp_path):
    """As of one that failed before the second."""
    one = {name: getattr(recording, name)[:1] for name in PIECES if name != "limit"}
    (tmp_path / "one.npz").write_bytes(replace(recording, **one).to_bytes())
    assert len(Recording.read(tmp_path / "one.npz").t) == 1


def test_recordings_lie_in_their_folder_and_have_their_ending(tmp_path):
    """Other files of the run are none, wherever they lie."""
    with RunFolder.claim(tmp_path / "run", "evaluation") as folder:
        folder.replace(dict.fromkeys(["other.npz", "recordings/ahsc.npz", "recordings/notes.txt"], b""))
        assert [file.name for file in recording_files(folder)] == ["ahsc.npz"]

"""The library of compiled code: which level is loaded, when it is built, and what happens without one."""

import json
import os
import subprocess
import sys
import threading
import warnings

import numpy as np
import pytest
from project import PACKAGES

from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.rollout import rollout
from sffr_gym.compile import library
from sffr_gym.compile.kernels import KERNELS
from sffr_gym.compile.library import LEVELS, load_library
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.simulator import Simulator

ON_A_GPU = {"sffr_gym.envs.device_episodes", "sffr_gym.task.pcg64"}  # compiled elsewhere, see sffr_gym.compile.cuda
V2 = {"sse4_2", "ssse3", "popcnt"}
V3 = V2 | {"avx2", "bmi1", "bmi2", "f16c", "fma", "movbe"}
V4 = V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}


@pytest.fixture
def fresh(monkeypatch):
    """Let the library be looked for anew, in the test and after it."""
    for name in (library.INTERPRETED, library.LEVEL):
        monkeypatch.delenv(name, raising=False)
    load_library.cache_clear()
    yield monkeypatch
    load_library.cache_clear()


@pytest.fixture
def folder(fresh, tmp_path):
    fresh.setattr(library, "FOLDER", tmp_path / "binaries")
    return tmp_path / "binaries"


def processor(monkeypatch, features, machine="x86_64"):
    monkeypatch.setattr(library.platform, "machine", lambda: machine)
    monkeypatch.setattr(library, "processor_features", lambda: set(features))


@pytest.mark.parametrize(
    ("text", "features"),
    [
        ("processor\t: 0\nflags\t\t: fpu avx2 fma\nbugs\t: x\n\nflags\t\t: fpu\n", {"fpu", "avx2", "fma"}),
        ("Features\t: fp asimd\n", set()),  # ARM
        ("flags\t\t:\n", set()),
        ("", set()),
        ("model name\t: \udcff\nflags: avx2\n", {"avx2"}),
    ],
)
def test_features_are_those_of_the_first_processor(tmp_path, text, features):
    (tmp_path / "cpuinfo").write_bytes(text.encode("utf-8", "surrogateescape"))
    assert library.processor_features(tmp_path / "cpuinfo") == features


def test_no_features_are_known_without_a_file(tmp_path):
    assert library.processor_features(tmp_path / "missing") == set()


@pytest.mark.parametrize(
    ("features", "levels"),
    [
        (V4, ["x86-64-v4", "x86-64-v3", "x86-64-v2"]),
        (V4 - {"avx512vl"}, ["x86-64-v3", "x86-64-v2"]),
        (V4 - {"movbe"}, ["x86-64-v2"]),  # a level has all that the ones below it have
        (V2, ["x86-64-v2"]),
        (set(), ["x86-64-v2"]),
    ],
)
def test_a_processor_has_the_levels_all_of_whose_features_it_has(monkeypatch, features, levels):
    processor(monkeypatch, features)
    assert library.own_levels() == levels


@pytest.mark.parametrize("machine", ["aarch64", "arm64"])
def test_another_machine_has_one_level(monkeypatch, machine):
    processor(monkeypatch, V4, machine)
    assert library.own_levels() == [library.HOST]


@pytest.mark.parametrize(
    ("features", "files", "asked", "level"),
    [
        (V4, [*LEVELS], "", "x86-64-v4"),
        (V3, [*LEVELS], "", "x86-64-v3"),
        (V4, ["x86-64-v2"], "", "x86-64-v2"),
        (V4, [*LEVELS], "x86-64-v2", "x86-64-v2"),
        (V3, [*LEVELS], "x86-64-v4", None),
        (V4, ["x86-64-v4"], "x86-64-v3", None),
        (V2, ["x86-64-v4", "x86-64-v3"], "", None),
        (V4, ["host"], "", None),  # of another machine
        (V4, [*LEVELS], "fastest", None),
    ],
)
def test_the_highest_level_of_the_processor_is_loaded_or_the_one_asked_for(monkeypatch, features, files, asked, level):
    processor(monkeypatch, features)
    monkeypatch.setenv(library.LEVEL, asked)
    if level is None:
        with pytest.raises(LookupError, match=f"for {files[0]}.*, this machine a x86_64 of"):
            library._level_to_load(dict.fromkeys(files, "kernels.so"))
    else:
        assert library._level_to_load(dict.fromkeys(files, "kernels.so")) == level


@pytest.fixture
def module(tmp_path, monkeypatch):
    """The source of a module that can be found."""
    (tmp_path / "law.py").write_text("GAIN = 1.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path / "law.py"


def test_the_hash_follows_every_source_and_its_name(module, tmp_path):
    first = library.hash_of(["law"])
    assert first and library.hash_of(["law"]) == first
    (tmp_path / "laws.py").write_text("GAIN = 1.0\n")
    assert len({first, library.hash_of(["laws"]), library.hash_of(["law", "laws"])}) == 3
    module.write_text("GAIN = 2.0\n")
    assert library.hash_of(["law"]) != first


@pytest.mark.parametrize("gone", ["no_such_law", "no_such_package.law"])
def test_a_source_that_is_gone_makes_the_library_stale(module, gone):
    assert library.hash_of(["law", gone]) == ""


def test_every_file_with_kernels_is_hashed():
    manifest = json.loads((library.FOLDER / library.MANIFEST).read_text())
    own = {function.__module__ for function in KERNELS if function.__module__.partition(".")[0] in PACKAGES}
    assert {"sffr_gym.physics.dynamics", "sffr_baselines.mic", "sffr_gym.compile.linalg"} < own
    assert own - ON_A_GPU <= {*manifest["modules"]}
    assert {"sffr_gym.compile.arguments", "sffr_gym.compile.builder.views"} < {*manifest["modules"]}


class Builder:
    """Stands for the process that builds; leaves a manifest of the present sources."""

    def __init__(self, folder):
        self.folder, self.runs = folder, []

    def __call__(self, command, **options):
        self.runs.append((command, options))
        assert options["check"]
        if self.fails():
            raise subprocess.CalledProcessError(1, command[:1])
        manifest = {"sources": library.hash_of(["law"]), "modules": ["law"], "functions": {}, "files": {}}
        (self.folder / library.MANIFEST).write_text(json.dumps(manifest))

    def fails(self):
        return False


@pytest.fixture
def builder(folder, monkeypatch):
    made = Builder(folder)
    monkeypatch.setattr(library.subprocess, "run", made)
    return made


def test_the_library_is_built_where_sources_have_changed(builder, module, folder, capsys):
    for text, builds in (("GAIN = 1.0\n", 1), ("GAIN = 1.0\n", 1), ("GAIN = 2.0\n", 2)):
        module.write_text(text)
        assert library._built_manifest()["modules"] == ["law"]
        assert len(builder.runs) == builds
    command, options = builder.runs[0]
    assert command == [sys.executable, "-P", "-m", "sffr_gym.compile.builder", str(folder)]
    assert options["env"][library.INTERPRETED] == "1"
    out, err = capsys.readouterr()
    assert out == "" and err.count("compiling the kernels") == err.count("\n") == 2


@pytest.mark.parametrize(
    "manifest",
    [
        "",
        "{",
        "[1]",
        "{}",
        '{"sources": "", "modules": 1}',
        '{"sources": "", "modules": [1]}',
        json.dumps({"sources": library.hash_of([]), "modules": [], "functions": {}, "files": []}),
        json.dumps({"sources": library.hash_of([]), "modules": [], "functions": {}, "files": {"host": "gone.so"}}),
    ],
)
def test_a_damaged_library_is_built_anew(builder, module, folder, manifest):
    folder.mkdir()
    (folder / library.MANIFEST).write_text(manifest)
    assert library._built_manifest()["modules"] == ["law"]
    assert len(builder.runs) == 1


def test_of_many_at_once_one_builds(builder, module):
    found = []
    threads = [threading.Thread(target=lambda: found.append(library._built_manifest())) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8 and all(manifest == found[0] for manifest in found)
    assert len(builder.runs) == 1


def write_manifest(folder, **changes):
    folder.mkdir()
    manifest = {"sources": library.hash_of([]), "modules": [], "functions": {}, "files": {}}
    (folder / library.MANIFEST).write_text(json.dumps(manifest | changes))


def interpreted_step():
    env = SFFRFlexEnv()
    env.reset(seed=0)
    return env.step(np.full(15, 0.1))[0]


def failing_builder(folder, builder):
    builder.fails = lambda: True


def no_level(folder, builder):
    write_manifest(folder, files={"x86-64-v9": "kernels.so"})
    (folder / "kernels.so").touch()


def damaged_file(folder, builder):
    write_manifest(folder, files=dict.fromkeys([*LEVELS, library.HOST], "kernels.so"))
    (folder / "kernels.so").write_bytes(b"\x7fELF, or so")


def no_entries(folder, builder):
    write_manifest(folder)


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (failing_builder, "exit status 1"),
        (no_level, "the library is for x86-64-v9"),
        (damaged_file, "kernels.so"),
        (no_entries, "the library is for "),
    ],
)
def test_without_a_library_kernels_run_as_python_with_a_warning(folder, builder, harm, reason):
    harm(folder, builder)
    with pytest.warns(UserWarning, match=f"(?s)no compiled code for this machine.*{reason}.*kernels run as Python"):
        assert load_library() is None
    assert np.isfinite(interpreted_step()).all()  # and no further warning


def test_who_asks_for_python_gets_it_without_a_warning(fresh):
    fresh.setenv(library.INTERPRETED, "1")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load_library() is None
    fresh.setenv(library.INTERPRETED, "0")
    load_library.cache_clear()
    assert load_library() is not None


def environment_steps():
    env = SFFRFlexEnv("noise")
    outputs = [env.reset(seed=3)[0]]
    for action in np.random.default_rng(0).uniform(-0.3, 0.3, (20, 15)):
        obs, reward, *_ = env.step(action)
        outputs += [obs, [reward]]
    return np.concatenate(outputs)


def damping_steps():
    env = SFFRFlexDampingEnv(agent_period=0.01)
    env.reset(seed=3)
    outputs = [np.append(*env.step(np.full(4, action))[:2]) for action in (0.3, -0.8, 1.0, -0.1)]
    return np.concatenate([*outputs, env._batch.p[0], env._damping.law.B_hat.ravel()])


def law_actions():
    env = SFFRFlexEnv()
    policies = [make_policy(name, env) for name in ("ahsc", "lqr")]
    rng, (obs, _) = np.random.default_rng(0), env.reset(seed=0)
    return np.concatenate([policy(obs + 0.01 * rng.normal(size=52)) for _ in range(10) for policy in policies])


def loop_periods():
    env = SFFRFlexEnv("impulse")
    env.reset(options={"scenario": env.scenario.model_copy(update={"duration": 0.04})})
    trajectory = rollout(env, make_policy("ahsc", env), seed=0)
    return np.concatenate([trajectory.signals.ravel(), trajectory.obs.ravel(), trajectory.lam.ravel()])


def simulator_steps():
    simulator = Simulator()
    state = simulator.initial_state()
    for _ in range(10):
        state = simulator.step(state, base=[3.0, -1.0, 0.2], joints=np.full(6, 0.1))
    return np.concatenate([state.q, state.qd, state.qf.ravel(), state.obj, simulator.q_flex(state)])


@pytest.mark.parametrize("numbers", [environment_steps, damping_steps, law_actions, loop_periods, simulator_steps])
def test_python_gives_the_bits_of_compiled_code(fresh, numbers):
    compiled = numbers()
    assert load_library() is not None
    load_library.cache_clear()
    fresh.setenv(library.INTERPRETED, "1")
    python = numbers()
    assert load_library() is None
    np.testing.assert_array_equal(python, compiled)


NO_COMPILER = """
import sys
import gymnasium, sffr_gym, sffr_baselines
{}
print([name for name in ("numba", "llvmlite") if name in sys.modules])
"""
STEP = """
env = gymnasium.make("SFFRFlex-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
"""
EVALUATE = """
from sffr_workbench.cli.app import app
app(["evaluate", "ahsc", "--scenario", {scenario!r}, "--no-figures", "--out", {out!r}], standalone_mode=False)
"""


@pytest.mark.parametrize("code", [STEP, EVALUATE], ids=["step", "evaluate"])
def test_no_compiler_is_imported(code, tmp_path, user_scenario):
    code = NO_COMPILER.format(code.format(scenario=user_scenario(duration=0.1), out=str(tmp_path / "run")))
    env = os.environ | {"MPLBACKEND": "agg"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
    assert (tmp_path / "run").is_dir() == ("evaluate" in code)


def test_the_library_depends_on_all_that_goes_into_it():
    modules = set(library.current_manifest(library.FOLDER)["modules"])
    kernels = {function.__module__ for function in KERNELS if function.__module__.startswith(("sffr_gym", "sffr_b"))}
    assert kernels - ON_A_GPU <= modules
    assert {"sffr_gym.physics.beam", "sffr_gym.task.scenario"} <= modules, "N_TIP, MOST_IMPULSES"
    assert {"sffr_gym.task.task_model", "sffr_gym.physics.model"} <= modules, "TaskModel, Model"
    assert {"sffr_gym.compile.builder.views", "sffr_gym.envs.exemplars", "sffr_gym.envs.lane_plants"} <= modules

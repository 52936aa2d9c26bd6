"""Jobs on processes, on Ray and on Dask: the same rows bit for bit, and a node that dies costs no finished episode."""

import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path

import psutil
import pytest
from command_line import sffr

from sffr_gym import ConfigError, load_params
from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.benchmark import episodes
from sffr_workbench.benchmark.episodes import Plan, run_episodes
from sffr_workbench.benchmark.rows import ROWS
from sffr_workbench.common import Backend, WorkersLost

SEED = 1_000_000
SWINGING = "name: swinging\ndescription: Swings.\nduration: {}\npanel_modes: [{{mode: 1, amplitude: [0.05, 0.25]}}]\n"
RAY = Path(sysconfig.get_path("scripts")) / "ray"
CLUSTER = [pytest.param(name, marks=pytest.mark.slow) for name in ("ray", "dask")]


@pytest.fixture(autouse=True)
def importable_tests(monkeypatch):
    """Workers import this module."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))


def rows(folder):
    """Finished episodes of a folder: file and bytes."""
    return {file.relative_to(folder): file.read_bytes() for file in sorted((folder / ROWS).rglob("*.json"))}


def run_plan(plan, folder, backend=None, progress=lambda *_: None):
    with RunFolder.claim(folder, "benchmark", resume=True) as run:
        return run_episodes(plan, run, 2, progress=progress, backend=backend)


def scenario_plan(folder, duration, count):
    file = folder / "swinging.yaml"
    file.write_text(SWINGING.format(duration))
    return Plan(("hsc", "ahsc"), (str(file),), count, SEED, load_params())


def divide(number):
    """A job of the test."""
    return 12 / number


def end_worker(number):
    """A job that kills the process that runs it."""
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("name", ["loky", *CLUSTER])
def test_jobs_come_back_and_errors_of_jobs_too(name):
    """Each result once; what a job raises is raised here, by its own class."""
    pytest.importorskip({"loky": "joblib", "ray": "ray", "dask": "distributed"}[name])
    backend = Backend(name)
    assert sorted(backend.run(divide, [(k,) for k in range(1, 13)], 2)) == sorted(12 / k for k in range(1, 13))
    assert list(backend.run(divide, [], 2)) == []
    with pytest.raises(ZeroDivisionError):
        list(backend.run(divide, [(1,), (0,)], 2))


@pytest.mark.parametrize("name", ["loky", pytest.param("ray", marks=pytest.mark.slow)])
def test_workers_that_die_again_and_again_are_told(name):
    """A job that kills whoever runs it ends the run, not the program."""
    pytest.importorskip({"loky": "joblib", "ray": "ray"}[name])
    with pytest.raises(WorkersLost):
        list(Backend(name).run(end_worker, [(1,), (2,)], 2))


@pytest.mark.parametrize("name", CLUSTER)
def test_rows_are_those_of_this_machine(name, tmp_path):
    """Bit for bit, in files that the asking process wrote."""
    pytest.importorskip({"ray": "ray", "dask": "distributed"}[name])
    plan = scenario_plan(tmp_path, 0.4, 3)
    expected = run_plan(plan, tmp_path / "here")
    assert run_plan(plan, tmp_path / "there", Backend(name)) == expected
    assert rows(tmp_path / "there") == rows(tmp_path / "here") and len(rows(tmp_path / "here")) == 6


def ray_node(*options):
    """Start a node as a process of this machine."""
    command = [str(RAY), "start", "--num-cpus=1", "--disable-usage-stats", "--block", *options]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


ALIVE = "import ray, sys; ray.init(sys.argv[1], log_to_driver=False); print(sum(n['Alive'] for n in ray.nodes()))"


def alive(address):
    """How many nodes of a cluster live; 0 if it does not answer."""
    try:
        asked = subprocess.run([sys.executable, "-c", ALIVE, address], capture_output=True, text=True, timeout=40)
    except subprocess.TimeoutExpired:
        return 0
    return int(asked.stdout) if asked.returncode == 0 else 0


@pytest.fixture
def two_nodes(monkeypatch):
    """The address of a Ray cluster of two nodes, and its second node's process."""
    pytest.importorskip("ray")
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")  # whatever other clusters of this user ask for
    port = 6390 + os.getpid() % 100
    folder = tempfile.mkdtemp(
        prefix="ray-"
    )  # of its own, or later clients would look for this head; sockets want it short
    head = ray_node("--head", f"--port={port}", "--include-dashboard=false", f"--temp-dir={folder}")
    address, nodes = f"127.0.0.1:{port}", [head]
    try:
        until(lambda: alive(address) == 1)
        nodes.append(ray_node(f"--address={address}"))
        until(lambda: alive(address) == 2)
        yield address, nodes[1]
    finally:
        for node in nodes:
            if node.poll() is None:
                os.killpg(node.pid, signal.SIGKILL)
                node.wait(30)
        shutil.rmtree(folder, ignore_errors=True)


def until(holds, seconds=240.0):
    """Wait until something holds."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.2)


def command_on(address, plan, folder):
    """Start the command of a user whose benchmark runs on a cluster."""
    given = ["hsc", "ahsc", "-s", plan.scenarios[0], "-n", str(plan.episodes), "--no-figures", "--out", str(folder)]
    command = [sys.executable, "-m", "sffr_gym", "benchmark", *given, "--backend", "ray", "--address", address]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


@pytest.mark.slow
def test_a_killed_node_costs_only_its_running_episodes(two_nodes, tmp_path):
    """A node is killed with all that it runs in the middle of a benchmark: no row is missing, all are the same."""
    address, second = two_nodes
    plan, folder = scenario_plan(tmp_path, 30.0, 30), tmp_path / "cluster"
    command = command_on(address, plan, folder)
    until(lambda: len(rows(folder)) >= 4 or command.poll() is not None)
    parts = [(each, each.name()) for each in psutil.Process(second.pid).children(recursive=True)]
    assert command.poll() is None and any("raylet" in name for _, name in parts)
    worked = any(name.startswith("ray::") or "_run_and_keep" in " ".join(each.cmdline()) for each, name in parts)
    os.killpg(second.pid, signal.SIGKILL)
    before = rows(folder)
    _, errors = command.communicate(timeout=500)
    assert command.returncode == 0, errors
    assert worked and 4 <= len(before) < 60 and before.items() <= rows(folder).items()
    run_plan(plan, tmp_path / "here")
    assert len(rows(folder)) == 60 and rows(folder) == rows(tmp_path / "here")
    assert json.loads((folder / "manifest.json").read_text())["backend"] == "ray"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nonsense",), "backend 'nonsense': must be one of loky, ray, dask"),
        (("loky", "127.0.0.1:1"), "address = 127.0.0.1:1: is that of a cluster; add --backend ray or dask"),
    ],
)
def test_a_backend_that_cannot_be_is_refused(arguments, message, tmp_path):
    """Before anything runs, by the command too."""
    with pytest.raises(ConfigError) as error:
        Backend(*arguments)
    assert str(error.value) == message
    options = [f for pair in zip(("--backend", "--address"), arguments, strict=False) for f in pair]
    result = sffr("benchmark", "ahsc", "--out", tmp_path / "run", *options)
    assert result.exit_code == 2 and message in result.stderr and not (tmp_path / "run").exists()


def test_a_missing_cluster_library_names_its_extra(monkeypatch):
    monkeypatch.setattr("sffr_workbench.common.extras.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"not installed: ray; pip install 'sffr-gym\[cluster\]'"):
        Backend("ray")


def test_a_node_with_other_code_is_refused(tmp_path):
    """Its rows would stand in one table with those of this code."""
    plan = scenario_plan(tmp_path, 0.1, 1)
    with pytest.raises(ConfigError, match=r"node .*: has other code of sffr-gym"):
        episodes.run_and_keep(plan.tasks[:1], plan.params, "0" * 16, None)

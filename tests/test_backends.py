"""Jobs on processes, on Ray and on Dask: the same rows bit for bit, and a node that dies costs no finished episode."""

import json
import os
import signal
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

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


@pytest.fixture
def two_nodes():
    """The address of a Ray cluster of two nodes, and its second node's process."""
    ray = pytest.importorskip("ray")
    port = 6390 + os.getpid() % 100
    head = ray_node("--head", f"--port={port}", "--include-dashboard=false")
    address, nodes = f"127.0.0.1:{port}", [head]
    try:
        for _ in range(60):
            time.sleep(1.0)
            if len(nodes) == 1 and head.poll() is None:
                try:
                    ray.init(address=address, log_to_driver=False)
                except (ConnectionError, RuntimeError, ValueError):
                    continue
                nodes.append(ray_node(f"--address={address}"))
            if ray.is_initialized() and sum(node["Alive"] for node in ray.nodes()) == 2:
                break
        assert sum(node["Alive"] for node in ray.nodes()) == 2
        ray.shutdown()
        yield address, nodes[1]
    finally:
        ray.shutdown()
        for node in nodes:
            if node.poll() is None:
                os.killpg(node.pid, signal.SIGTERM)
                node.wait(30)


@pytest.mark.slow
def test_a_killed_node_costs_only_its_running_episodes(two_nodes, tmp_path):
    """A node is killed with all that it runs in the middle of a benchmark: no row is missing, all are the same."""
    address, second = two_nodes
    plan = scenario_plan(tmp_path, 20.0, 20)
    killed = []

    def kill_once(what, done, total):
        if done == 6 and not killed:
            os.killpg(second.pid, signal.SIGKILL)
            killed.append(done)

    found = run_plan(plan, tmp_path / "cluster", Backend("ray", address), kill_once)
    assert killed == [6] and second.wait(10) == -signal.SIGKILL
    assert len(found) == 40
    assert found == run_plan(plan, tmp_path / "here")
    assert rows(tmp_path / "cluster") == rows(tmp_path / "here")


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
        episodes._run_and_keep(plan.tasks[0], plan.params, "0" * 16, None)


@pytest.mark.slow
def test_the_command_runs_on_a_cluster(two_nodes, tmp_path):
    """As a user types it; the manifest tells what ran it."""
    plan = scenario_plan(tmp_path, 0.4, 2)
    command = [sys.executable, "-m", "sffr_gym", "benchmark", "hsc", "ahsc", "-s", plan.scenarios[0], "-n", "2"]
    options = ["--no-figures", "--out", str(tmp_path / "run"), "--backend", "ray", "--address", two_nodes[0]]
    done = subprocess.run([*command, *options], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["backend"] == "ray" and len(rows(tmp_path / "run")) == 4

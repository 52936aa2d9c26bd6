"""How many processors a batch and ``--jobs`` use: affinity, quota of the container, and the usual variables."""

import os
import subprocess
import sys
from math import inf

import pytest

from sffr_gym.compile import threads

MANY = 64  # processors


@pytest.fixture
def machine(monkeypatch):
    """A machine with many processors and neither quota nor variables."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(MANY)), raising=False)
    monkeypatch.setattr(threads, "cpu_quota", lambda: inf)
    for name in threads.VARIABLES:
        monkeypatch.delenv(name, raising=False)
    return monkeypatch


def test_all_processors_of_the_affinity_are_used(machine):
    assert threads.available_cores() == MANY
    machine.delattr(os, "sched_getaffinity")
    machine.setattr(os, "cpu_count", lambda: None)
    assert threads.available_cores() == 1


@pytest.mark.parametrize("name", ["OMP_NUM_THREADS", "NUMBA_NUM_THREADS"])
@pytest.mark.parametrize(
    ("value", "expected"),
    [("1", 1), (" 3 ", 3), ("4,2", 4), ("4, 2", 4), ("1000000", MANY)]
    + [(value, MANY) for value in ("", "abc", "0", "-1", "2.5", ",", ",2", "nan", "inf", "1e2")],
)
def test_variables_limit(machine, name, value, expected):
    """What is no number of threads counts as unset."""
    machine.setenv(name, value)
    assert threads.available_cores() == expected


@pytest.mark.parametrize(("quota", "expected"), [(0.5, 1), (1.0, 1), (2.9, 2), (1000.0, MANY), (inf, MANY)])
def test_quota_limits_to_whole_processors(machine, quota, expected):
    machine.setattr(threads, "cpu_quota", lambda: quota)
    assert threads.available_cores() == expected


def test_the_smallest_limit_holds(machine):
    machine.setattr(threads, "cpu_quota", lambda: 5.0)
    machine.setenv("OMP_NUM_THREADS", "7")
    assert threads.available_cores() == 5
    machine.setenv("NUMBA_NUM_THREADS", "3")
    assert threads.available_cores() == 3


def control_groups(folder, own, files):
    """The quota where a process is in the groups ``own`` and the mount has these files."""
    (folder / "own").write_text(own)
    for name, text in files.items():
        (folder / "mount" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "mount" / name).write_text(text)
    return threads.cpu_quota(folder / "mount", folder / "own")


V1 = "4:cpu,cpuacct:/docker/1f\n3:cpuset:/\n1:name=systemd:/\n"


@pytest.mark.parametrize(
    ("own", "files", "expected"),
    [
        ("0::/\n", {"cpu.max": "150000 100000\n"}, 1.5),
        ("0::/\n", {"cpu.max": "max 100000\n"}, inf),
        ("0::/\n", {}, inf),
        ("0::/a/b\n", {"a/b/cpu.max": "max 100000\n", "a/cpu.max": "200000 100000\n"}, 2.0),
        ("0::/a/b\n", {"a/b/cpu.max": "300000 100000\n", "a/cpu.max": "400000 100000\n"}, 3.0),
        ("0::/a\n", {"b/cpu.max": "100000 100000\n"}, inf),  # another one's
        ("0::/not/visible\n", {"cpu.max": "200000 100000\n"}, 2.0),
        ("0::/../../outside\n", {"cpu.max": "200000 100000\n"}, 2.0),
        ("1:cpu:/\n0::/\n", {"unified/cpu.max": "200000 100000\n"}, 2.0),
        (
            V1,
            {"cpu,cpuacct/docker/1f/cpu.cfs_quota_us": "-1", "cpu,cpuacct/docker/1f/cpu.cfs_period_us": "100000"},
            inf,
        ),
        (V1, {"cpu/cpu.cfs_quota_us": "250000\n", "cpu/cpu.cfs_period_us": "100000\n"}, 2.5),
        (V1, {"cpu,cpuacct/docker/cpu.cfs_quota_us": "5", "cpu,cpuacct/docker/cpu.cfs_period_us": "10"}, 0.5),
        (V1, {"cpuset/cpu.cfs_quota_us": "5", "cpuset/cpu.cfs_period_us": "10"}, inf),
        ("0::/\n", {"cpu.max": "lots\n"}, inf),
        ("0::/\n", {"cpu.max": "100000 0\n"}, inf),
        ("0::/\n", {"cpu.max": ""}, inf),
        ("nonsense\n\n0::/\n", {"cpu.max": "200000 100000\n"}, 2.0),
        ("", {"cpu.max": "200000 100000\n"}, inf),
    ],
)
def test_quotas_of_control_groups_of_both_versions(tmp_path, own, files, expected):
    assert control_groups(tmp_path, own, files) == expected


def test_no_control_groups_no_quota(tmp_path):
    assert threads.cpu_quota(tmp_path, tmp_path / "missing") == inf
    (tmp_path / "own").write_bytes(b"0::/\xff\n")
    assert threads.cpu_quota(tmp_path, tmp_path / "own") == inf


def test_the_batch_and_the_number_of_jobs_follow(tmp_path):
    """In a new process: both are settled when it starts. Who asks for more jobs gets them."""
    code = (
        "import sffr_gym.envs.batch, sffr_workbench.cli.benchmark as benchmark, sffr_workbench.cli.options as options\n"
        "print(sffr_gym.envs.batch.THREADS, benchmark.available_cores(), options.MOST_JOBS)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"OMP_NUM_THREADS": "1,4"}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == ["1", "1", str(4 * os.cpu_count())]

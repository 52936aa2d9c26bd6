"""How many threads of compiled code, or processes, may run at once."""

from __future__ import annotations

import os
from math import inf
from pathlib import Path

VARIABLES = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
CGROUPS = Path("/sys/fs/cgroup")
OWN_CGROUPS = Path("/proc/self/cgroup")


def available_cores() -> int:
    """Return how many processors this process should use, at least one.

    The smallest of

    - the processors that it may run on (its affinity, where the system has one),
    - the processors' time that its container or control group grants, in whole processors,
    - ``OMP_NUM_THREADS``, of a list the first, and ``NUMBA_NUM_THREADS``. What is no positive integer is ignored.
    """
    affinity = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, int(min(affinity, cpu_quota(), *(_number(os.environ.get(name, "")) for name in VARIABLES))))


def cpu_quota(mounts: Path = CGROUPS, own: Path = OWN_CGROUPS) -> float:
    """Return how many processors the control groups of this process grant, of both versions; inf without a limit.

    Args:
        mounts: where the control groups are mounted.
        own: the file that names those of this process.
    """
    try:
        lines = own.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return inf
    quota = inf
    for _, controllers, path in (line.split(":", 2) for line in lines if line.count(":") > 1):
        if not controllers:  # version 2
            folders = [mounts, mounts / "unified"]
        elif "cpu" in controllers.split(","):
            folders = [mounts / controllers, mounts / "cpu"]
        else:
            continue
        quota = min([quota, *(_least_quota(folder, path) for folder in folders)])
    return quota


def _least_quota(mount: Path, path: str) -> float:
    """The least quota of a control group and of those that hold it.

    A container sees its own group at the mount, whatever the path says; groups that it does not see are skipped.
    """
    group = mount.joinpath(*(part for part in path.split("/") if part not in ("", "..")))
    groups = [group, *group.parents]
    return min(_quota(each) for each in groups[: groups.index(mount) + 1])


def _quota(group: Path) -> float:
    """The quota of one control group in processors; inf if it has none."""
    both = _words(group / "cpu.max") or _words(group / "cpu.cfs_quota_us") + _words(group / "cpu.cfs_period_us")
    try:
        quota, period = map(int, both)
    except ValueError:  # such as "max"
        return inf
    return quota / period if quota > 0 and period > 0 else inf


def _words(file: Path) -> list[str]:
    try:
        return file.read_text(encoding="utf-8").split()
    except (OSError, ValueError):
        return []


def _number(text: str) -> float:
    """A positive integer, of several between commas the first; inf if it is none."""
    try:
        number = int(text.partition(",")[0])
    except ValueError:
        return inf
    return number if number > 0 else inf

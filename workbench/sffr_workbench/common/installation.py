"""What is installed here and whether it works: for ``sffr doctor``, which tells people what to do."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from packaging.requirements import Requirement

from sffr_gym.compile.library import INTERPRETED, LEVEL, is_interpreted, load_library
from sffr_gym.compile.threads import VARIABLES, available_cores, cpu_quota
from sffr_gym.config.provenance import git_state, package_version

PROJECT = "sffr-gym"
MODULES = {  # by the name of the distribution, where they differ by more than case and hyphens; some have none
    "pyyaml": "yaml", "pillow": "PIL", "pygame-ce": "pygame", "pin": "pinocchio",
    "cupy-cuda13x": "cupy", "nvidia-nvvm": None,
}  # fmt: skip
OF_DEVELOPERS = ("dev", "docs", "compile", "all")  # extras that no user needs
IMPORT = 120.0  # s that an import may take
SMALLEST_DISK = 1e9  # bytes that results want


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    what: str
    state: str  #: what was found
    advice: str = ""  #: what to do, if anything
    broken: bool = False  #: nothing works without it


def core_findings() -> Iterator[Finding]:
    """Yield what every use needs: versions, compiled code, processors, a place for results."""
    checkout = git_state(Path(__file__).parents[1])
    commit = f", checkout {checkout['commit'][:12]}" if checkout else ""
    yield Finding("sffr-gym", f"{package_version(PROJECT) or 'not installed as a package'}{commit}")
    yield Finding("Python", f"{platform.python_version()}, {sys.executable}, {platform.platform()}")
    yield from _dependencies()
    yield _kernels()
    yield _step()
    yield _processors()
    yield _results()


def extra_findings() -> Iterator[Finding]:
    """Yield each extra of users, with what is missing of it; what is there is imported in a process of its own."""
    own = [Requirement(text) for text in requires(PROJECT) or []]
    extras = sorted({extra for each in own for extra in _extras_of(each)} - set(OF_DEVELOPERS))
    for extra in extras:
        yield _extra(extra, [each for each in own if extra in _extras_of(each) and each.name != PROJECT])
    if package_version("pygame") and package_version("pygame-ce"):
        yield Finding(
            "pygame", "pygame and pygame-ce are both installed, and overwrite each other",
            "pip uninstall -y pygame; pip install --force-reinstall pygame-ce",
        )  # fmt: skip


def _dependencies() -> Iterator[Finding]:
    """Yield the packages that every use needs, those out of range as broken."""
    own = [Requirement(text) for text in requires(PROJECT) or []]
    core = [each for each in own if not _extras_of(each)]
    wrong = [text for each in core if (text := _lack(each))]
    shown = ", ".join(f"{each.name} {package_version(each.name)}" for each in core if package_version(each.name))
    yield Finding("packages", shown)
    if wrong:
        yield Finding("packages", "; ".join(wrong), f"pip install --upgrade {PROJECT}", broken=True)


def _kernels() -> Finding:
    if is_interpreted():
        return Finding(
            "kernels", f"run as Python, some thousand times slower, since {INTERPRETED} is set", f"unset {INTERPRETED}"
        )
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        library = load_library()
    if library is None:
        why = str(told[0].message) if told else "no compiled code"
        advice = f"pip install '{PROJECT}[compile]', or a wheel for this machine; unset {LEVEL} if it is set"
        return Finding("kernels", why, advice, broken=True)
    return Finding("kernels", f"compiled: {library.file}")


def _step() -> Finding:
    """Let an environment take a step."""
    try:
        import gymnasium

        import sffr_gym  # noqa: F401

        env = gymnasium.make("SFFRFlex-v0")
        env.reset(seed=0)
        reward = float(env.step(env.action_space.sample() * 0.0)[1])
    except Exception as error:  # whatever is wrong with it
        return Finding("a step", f"{type(error).__name__}: {error}", "see above; else file a report", broken=True)
    return Finding("a step", f"SFFRFlex-v0 runs, reward {reward:.3g}")


def _processors() -> Finding:
    own = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    limits = [f"{name}={os.environ[name]}" for name in VARIABLES if name in os.environ]
    quota = cpu_quota()
    if quota < own:
        limits.append(f"a quota of {quota:g}")
    why = f", limited by {', '.join(limits)}" if limits and available_cores() < own else ""
    advice = f"unset {VARIABLES[0]} to use all" if available_cores() < min(own, quota) else ""
    return Finding("processors", f"{available_cores()} used of {own}{why}", advice)


def _results() -> Finding:
    folder = Path("runs").absolute()
    there = next(each for each in (folder, *folder.parents) if each.exists())
    free = shutil.disk_usage(there).free
    state = f"{folder}, {free / 1e9:.0f} GB free"
    if not os.access(there, os.W_OK):
        return Finding("results", f"{state}; {there} cannot be written", "change to another folder, or give --out")
    return Finding("results", state, "give --out on another disk" if free < SMALLEST_DISK else "")


def _extra(extra: str, needed: list[Requirement]) -> Finding:
    if missing := [text for each in needed if (text := _lack(each))]:
        return Finding(f"[{extra}]", "; ".join(missing), f"pip install '{PROJECT}[{extra}]'")
    names = (MODULES.get(each.name.lower(), each.name.lower().replace("-", "_")) for each in needed)
    modules = [name for name in names if name]
    shown = ", ".join(f"{each.name} {package_version(each.name)}" for each in needed)
    if not modules:
        return Finding(f"[{extra}]", "nothing of its own")
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", f"import {', '.join(modules)}"], capture_output=True, text=True, timeout=IMPORT
        )
    except subprocess.TimeoutExpired:
        return Finding(f"[{extra}]", f"{shown}; its import takes longer than {IMPORT:.0f} s", "look at the disk")
    if done.returncode:
        why = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        return Finding(
            f"[{extra}]", f"installed, but broken: {why}", f"pip install --force-reinstall '{PROJECT}[{extra}]'"
        )
    return Finding(f"[{extra}]", shown)


def _extras_of(requirement: Requirement) -> set[str]:
    """Return the extras that bring a requirement; empty for one of every use."""
    text = str(requirement.marker or "")
    return {part.split(quote)[1] for quote in "\"'" for part in text.split("extra ==")[1:] if quote in part}


def _lack(requirement: Requirement) -> str:
    """Return what is wrong with a requirement; empty for nothing."""
    try:
        found = version(requirement.name)
    except PackageNotFoundError:
        return f"{requirement.name} is not installed"
    if requirement.specifier.contains(found, prereleases=True):
        return ""
    return f"{requirement.name} {found} is not {requirement.specifier}"

"""Runs the programs of ``docs/clients`` with the real clients, each in an environment of its own, and tells what works.

``make clients`` runs all, ``make clients CLIENTS="skrl zoo"`` some. The table ``docs/clients/tried.md`` is written, the
rows of clients that were not asked for as they were. Environments are kept, below ``SFFR_CLIENTS`` or the folder of
temporary files, so that a second run installs nothing.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "clients"
TABLE = PAGES / "tried.md"
ROOMS = (".", "baselines", "agents", "workbench")
SCRATCH = Path(os.environ.get("SFFR_CLIENTS") or Path(tempfile.gettempdir()) / "sffr-clients")
BLOCK = re.compile(r"^```(python|bash)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LONGEST = 1200.0  # s of a program
HEAD = ["client", "version tried", "with", "command", "state"]


@dataclass(frozen=True)
class Client:
    """A client, and what its environment needs."""

    name: str  #: as people write it
    packages: tuple[str, ...]  #: that pip installs, the first of which has the client's version
    loose: tuple[str, ...] = ()  #: likewise, but without what they ask for
    script: str = ""  #: beside this file, run after the page


CLIENTS = {
    "sb3": Client("Stable-Baselines3", ("stable-baselines3", "sb3-contrib", "pillow")),
    "zoo": Client("RL Zoo", ("rl_zoo3", "sb3-contrib", "requests")),
    "cleanrl": Client(
        "CleanRL", ("torch", "tyro", "tensorboard", "stable-baselines3"), ("cleanrl==1.2.0",), "cleanrl_script.py"
    ),
    "rllib": Client("RLlib", ("ray[rllib]", "torch")),
    "torchrl": Client("TorchRL", ("torchrl", "torch")),
    "skrl": Client("skrl", ("skrl", "torch")),
    "tianshou": Client("Tianshou", ("tianshou",)),
    "minari": Client("Minari", ("minari", "h5py", "pillow", "torch")),
}


def main(names: list[str]) -> int:
    """Run the clients, write the table, and return how many failed."""
    unknown = [name for name in names if name not in CLIENTS]
    if unknown:
        sys.exit(f"unknown client {unknown[0]!r}; there are {', '.join(CLIENTS)}")
    failed = 0
    for name in names or list(CLIENTS):
        begun = time.monotonic()
        state = run(name)
        failed += state != "works"
        print(f"{CLIENTS[name].name}: {state} ({time.monotonic() - begun:.0f} s)", flush=True)
        write_row(name, state)
    return failed


def run(name: str) -> str:
    """Return ``works``, or what failed in a line."""
    client, folder = CLIENTS[name], SCRATCH / name
    python = folder / "bin" / "python"
    try:
        prepare(client, folder)
        with tempfile.TemporaryDirectory(prefix=f"sffr-{name}-") as work:
            programs = BLOCK.findall((PAGES / f"{name}.md").read_text(encoding="utf-8"))
            before = ""
            for k, (language, text) in enumerate(programs):
                if language == "python":
                    file = Path(work, f"program{k}.py")
                    file.write_text(before + text, encoding="utf-8")
                    before = text if name == "cleanrl" and k == 0 else ""
                    execute([str(python), str(file)], work, folder)
                else:
                    execute(["bash", "-eu", "-c", text], work, folder)
            if client.script:
                execute([str(python), str(Path(__file__).with_name(client.script))], work, folder)
    except subprocess.CalledProcessError as error:
        lines = [line for line in str(error.output or error).splitlines() if line.strip()]
        print("\n".join(lines[-30:]), file=sys.stderr)
        return f"fails: {lines[-1][:160] if lines else error}"
    except subprocess.TimeoutExpired as error:
        return f"fails: takes longer than {error.timeout:.0f} s"
    return "works"


def prepare(client: Client, folder: Path) -> None:
    """Make an environment with the client, what sffr-gym needs, and the checkout with its command on the path."""
    python, done = folder / "bin" / "python", folder / "prepared"
    if done.exists():
        return
    own = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    pip = [str(python), "-m", "pip", "install", "--quiet", "-c", str(ROOT / "constraints.txt")]
    call([sys.executable, "-m", "venv", str(folder)])
    call([*pip, *client.packages, *own])
    for package in client.loose:
        call([*pip, "--no-deps", "--ignore-requires-python", package])
    (site,) = folder.glob("lib/python*/site-packages")
    (site / "sffr-gym.pth").write_text("".join(f"{(ROOT / room).resolve()}\n" for room in ROOMS))
    command = folder / "bin" / "sffr"
    command.write_text(f"#!{python}\nfrom sffr_workbench.cli.main import main\n\nmain()\n")
    command.chmod(0o755)
    done.touch()


def execute(command: list[str], work: str, folder: Path) -> None:
    """Run a program of a page in a folder, by the client's environment."""
    own = {
        "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}", "SFFR_CONFIGS": str(ROOT / "configs"),
        "CUDA_VISIBLE_DEVICES": "", "RAY_AUTH_MODE": "disabled",
    }  # fmt: skip
    call(command, cwd=work, env=os.environ | own, timeout=LONGEST)


def call(command: list[str], **settings: object) -> None:
    """Run a command; its output is told where it fails."""
    subprocess.run(
        command, check=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, text=True,
        **settings,
    )  # type: ignore[call-overload]  # fmt: skip


def version_of(name: str, package: str) -> str:
    """Return the version of a package in a client's environment."""
    package = re.split(r"[\[=<>]", package)[0]
    code = f"from importlib.metadata import version; print(version({package!r}))"
    asked = subprocess.run([str(SCRATCH / name / "bin" / "python"), "-c", code], capture_output=True, text=True)
    return asked.stdout.strip() or "-"


def write_row(name: str, state: str) -> None:
    """Write a client's row into the table, others as they are."""
    client = CLIENTS[name]
    tried = client.loose[0] if client.loose else client.packages[0]
    cells = [
        f"[{client.name}]({name}.md)", version_of(name, tried), f"Gymnasium {version_of(name, 'gymnasium')}",
        f'`make clients CLIENTS="{name}"`', state.replace("|", "\\|"),
    ]  # fmt: skip
    old = TABLE.read_text(encoding="utf-8").splitlines() if TABLE.exists() else []
    rows = {found[1]: line for line in old if (found := re.match(r"\| \[[^]]*\]\((\w+)\.md\)", line))}
    rows[name] = f"| {' | '.join(cells)} |"
    lines = [f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|", *(rows[each] for each in CLIENTS if each in rows)]
    TABLE.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

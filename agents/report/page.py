"""The report: one HTML file that holds everything, scripts and pictures too, and asks the network for nothing."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from agents.figures import colours_of
from agents.files import to_json, write_whole
from agents.report.replay import episode_data, group
from agents.report.runs import Run, read_run
from agents.run_folder import package_version
from sffr_gym import ConfigError

PAGE = "report.html"
STYLES = ("style.css",)
# One module in the page, in this order: a file may use what those before it define.
SCRIPTS = (
    "theme.js", "recording.js", "robot.js", "scene.js", "panel_view.js", "chart.js", "time_chart.js", "summaries.js",
    "replay.js", "main.js",
)  # fmt: skip


def report(folders: Sequence[Path], out: Path, overwrite: bool = False) -> Path:
    """Write the report of finished runs.

    Args:
        folders: that ``sffr evaluate`` or ``sffr benchmark`` left.
        out: the file to write; its folder is made if need be.
        overwrite: whether it may be replaced.

    Returns:
        The file.

    Raises:
        ConfigError: if a folder holds no finished run, is given twice, or the file is there already.
        ModuleNotFoundError: without jinja2.
    """
    if out.exists() and not overwrite:
        raise ConfigError(f"{out}: is there already; choose another name with --out or add --overwrite")
    real = [folder.resolve() for folder in folders]
    for folder in real:
        if real.count(folder) > 1:
            raise ConfigError(f"{folder}: is given twice")
    text = page([read_run(folder) for folder in folders])
    out.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(out, text.encode())


def page(runs: Sequence[Run]) -> str:
    """The report as HTML."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("agents.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    return environment.get_template("report.html").render(
        runs=runs, episodes=_episodes(runs), manifests=[to_json(run.manifest) for run in runs],
        title=", ".join(dict.fromkeys(result.scenario for run in runs for result in run.results)),
        version=package_version("sffr-gym"), style=Markup(_texts(STYLES)), script=Markup(_texts(SCRIPTS)),
    )  # fmt: skip


def _episodes(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """What the replay can show, a colour for each policy in all of them."""
    groups = group([(run.name, recording) for run in runs for recording in run.recordings])
    colours = colours_of(dict.fromkeys(name for members in groups for name in members))
    return [episode_data(members, colours) for members in groups]


def _texts(names: Sequence[str]) -> str:
    """Files of the package, one behind the other."""
    folder = resources.files("agents.report") / "templates"
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in names)

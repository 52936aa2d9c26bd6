"""The report: one HTML file that holds everything, scripts and pictures too, and asks the network for nothing."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from sffr_baselines.policies import names_policy
from sffr_gym import ConfigError
from sffr_gym.config.files import check_target, to_json, write_whole
from sffr_gym.config.provenance import package_version
from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.common import template
from sffr_workbench.evaluation import open_run
from sffr_workbench.figures import policy_colours
from sffr_workbench.report.replay import episode_data, group_by_episode
from sffr_workbench.report.runs import Run, read_run

REPORT_FILE = "report.html"
STYLES = ("style.css",)
# One module in the page, in this order: a file may use what those before it define.
SCRIPTS = (
    "theme.js", "recording.js", "robot.js", "scene.js", "panel_view.js", "chart.js", "time_chart.js", "summaries.js",
    "replay.js", "main.js",
)  # fmt: skip


def write_report(folders: Sequence[Path], out: Path | None = None, overwrite: bool = False) -> Path:
    """Write the report of finished runs.

    Args:
        folders: that ``sffr evaluate`` or ``sffr benchmark`` left.
        out: the file to write, its folder made if need be; None for one in the first run's folder.
        overwrite: whether it may be replaced.

    Returns:
        The file.

    Raises:
        ConfigError: if a folder holds no finished run, or a damaged one, or is given twice, or is a policy instead,
            or the file is there already.
        ModuleNotFoundError: without jinja2.
    """
    real = [folder.resolve() for folder in folders]
    for folder in real:
        if real.count(folder) > 1:
            raise ConfigError(f"{folder}: is given twice")
    for folder in folders:
        if not folder.is_dir() and names_policy(str(folder)):
            way = f"sffr evaluate {folder} --out runs/mine, then sffr report runs/mine"
            raise ConfigError(f"{folder}: is a policy, and a report shows runs of policies; {way}")
    if out is not None:
        check_target(out, overwrite)
        text = report_page([read_run(folder) for folder in folders])
        out.parent.mkdir(parents=True, exist_ok=True)
        return write_whole(out, text.encode())
    first = open_run(folders[0])
    check_target(first.path / REPORT_FILE, overwrite)
    with RunFolder.claim(first.path, first.kind, resume=True) as run:
        run.check_names([REPORT_FILE])
        return run.write(REPORT_FILE, report_page([read_run(folder) for folder in folders]).encode())


def report_page(runs: Sequence[Run]) -> str:
    """Return the report as HTML; what is no text, such as of a file's name in another encoding, is "?" in it."""
    from markupsafe import Markup  # optional

    page = template("sffr_workbench.report").render(
        runs=runs, episodes=json.loads(to_json(_episodes(runs))),  # without NaN, which JavaScript refuses
        manifests=[run.repeat for run in runs],
        title=", ".join(dict.fromkeys(result.scenario for run in runs for result in run.results)),
        version=package_version("sffr-gym"), style=Markup(_texts(STYLES)), script=Markup(_texts(SCRIPTS)),
    )  # fmt: skip
    return str(page).encode("utf-8", "replace").decode()


def _episodes(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return what the replay can show, a colour for each policy in all of them."""
    groups = group_by_episode([(run.name, recording) for run in runs for recording in run.recordings])
    colours = policy_colours(dict.fromkeys(name for members in groups for name in members))
    return [episode_data(members, colours) for members in groups]


def _texts(names: Sequence[str]) -> str:
    """Join files of the package."""
    folder = resources.files("sffr_workbench.report") / "templates"
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in names)

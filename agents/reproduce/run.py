"""The work of ``sffr reproduce``: run, judge, draw, and leave a folder."""

from __future__ import annotations

import io
import shlex
from collections.abc import Sequence
from pathlib import Path

from agents.figures import DPI, STYLE
from agents.files import to_json, write_whole
from agents.reproduce import page
from agents.reproduce.claims import Claim, judge
from agents.reproduce.figures import Plate, paper_plates
from agents.reproduce.more_figures import further_plates
from agents.reproduce.peers import compare
from agents.reproduce.piezo_figure import piezo_plate
from agents.reproduce.study import Report, run_study
from agents.run_folder import PACKAGES, git_state, package_version

PAGE, CLAIMS_TABLE, CLAIMS = "index.html", "claims.md", "claims.json"


def reproduce(
    folder: Path, command: Sequence[str], duration: float | None, report: Report
) -> tuple[list[Claim], list[Path]]:
    """Run everything and write pictures, claims and page; the claims' JSON last, as the sign of a finished run.

    Args:
        folder: made if need be.
        command: the command line as typed.
        duration: of each run [s]; None for once around the circle.
        report: told what is done.

    Returns:
        The claims and the files, in the order in which they were written.

    Raises:
        ModuleNotFoundError: without matplotlib.
    """
    import matplotlib as mpl

    study = run_study(duration, report)
    report("the independent codes", 1, 2)
    claims = judge(study, compare())
    folder.mkdir(parents=True, exist_ok=True)
    (folder / CLAIMS).unlink(missing_ok=True)
    with mpl.rc_context(STYLE):
        plates = [*paper_plates(study), *further_plates(study), piezo_plate(study.params)]
        pictures = {}
        for done, plate in enumerate(plates):
            report(plate.title, done, len(plates))
            pictures[plate.file] = png(plate)
    texts = {
        PAGE: page.html(claims, plates, pictures, note(command, duration)),
        CLAIMS_TABLE: page.markdown(claims),
        CLAIMS: to_json(page.data(claims) | {"command": shlex.join(command), "duration_s": duration}),
    }
    contents = pictures | {name: text.encode() for name, text in texts.items()}
    return claims, [write_whole(folder / name, content) for name, content in contents.items()]


def png(plate: Plate) -> bytes:
    """A picture as the content of a file."""
    picture = io.BytesIO()
    plate.figure.savefig(picture, format="png", dpi=DPI)
    return picture.getvalue()


def note(command: Sequence[str], duration: float | None) -> str:
    """What was run, on which versions."""
    versions = ", ".join(f"{name} {version}" for name in PACKAGES if (version := package_version(name)))
    git = git_state(Path(__file__).parent)
    commit = f"; commit {git['commit'][:12]}{', changed' if git['dirty'] else ''}" if git else ""
    cut = f" Cut to {duration:g} s of each run: claims about the whole circle are not settled." if duration else ""
    return f"{shlex.join(command)}; {versions}{commit}.{cut}"

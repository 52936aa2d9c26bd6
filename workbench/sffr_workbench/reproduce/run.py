"""The work of ``sffr reproduce``: run, test the claims, draw, and leave a folder."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from sffr_gym.config.files import to_json
from sffr_gym.config.provenance import PACKAGES, git_state, package_version
from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.common import Progress, describe_commit, describe_versions
from sffr_workbench.figures.style import drawing, png
from sffr_workbench.reproduce.adaptation_figures import adaptation_figures
from sffr_workbench.reproduce.cases import run_cases
from sffr_workbench.reproduce.claims import Claim, assess_claims
from sffr_workbench.reproduce.cross_checks import run_cross_checks
from sffr_workbench.reproduce.page import claims_data, claims_markdown, claims_page
from sffr_workbench.reproduce.paper_figures import paper_figures
from sffr_workbench.reproduce.piezo_figure import piezo_figure
from sffr_workbench.reproduce.stability_figure import stability_figure

PAGE_FILE, MARKDOWN_FILE, CLAIMS_FILE = "index.html", "claims.md", "claims.json"
FIGURE_FILES = (
    "fig06.png", "fig06_starts.png", "fig07.png", "fig08.png", "fig09.png", "fig10.png", "fig11.png", "fig12.png",
    "fig13.png", "adaptation_integral.png", "gains.png", "stability.png", "piezo_authority.png",
)  # fmt: skip


def reproduce(
    run: RunFolder, command: Sequence[str], duration: float | None, progress: Progress
) -> tuple[list[Claim], list[Path]]:
    """Run everything and write pictures, claims and page, together at the end.

    Args:
        run: the folder.
        command: the command line as typed.
        duration: of each run [s]; None for once around the circle.
        progress: called with what is being done.

    Returns:
        The claims and the files.

    Raises:
        ConfigError: if a file is in the way that the folder's run did not write; nothing has run then.
            Also without matplotlib; see :func:`sffr_workbench.figures.style.load_matplotlib`.
    """
    run.check_names([*FIGURE_FILES, PAGE_FILE, MARKDOWN_FILE, CLAIMS_FILE])
    runs = run_cases(duration, progress)
    progress("the independent codes", 1, 2)
    claims = assess_claims(runs, run_cross_checks())
    with drawing():
        figures = paper_figures(runs) + adaptation_figures(runs)
        figures += [stability_figure(runs.params), piezo_figure(runs.params)]
        pngs = {}
        for done, each in enumerate(figures):
            progress(each.title, done, len(figures))
            pngs[each.file] = png(each.figure)
    texts = {
        PAGE_FILE: claims_page(claims, figures, pngs, note(command, duration)),
        MARKDOWN_FILE: claims_markdown(claims),
        CLAIMS_FILE: to_json(claims_data(claims) | {"command": shlex.join(command), "duration_s": duration}),
    }
    contents = pngs | {name: text.encode() for name, text in texts.items()}
    return claims, run.replace(contents, remove=run.files)


def note(command: Sequence[str], duration: float | None) -> str:
    """Return what was run, on which versions."""
    versions = describe_versions({name: package_version(name) for name in PACKAGES})
    git = git_state(Path(__file__).parent)
    commit = f"; commit {describe_commit(git)}" if git else ""
    cut = f" Cut to {duration:g} s of each run: claims about the whole circle are not settled." if duration else ""
    return f"{shlex.join(command)}; {versions}{commit}.{cut}"

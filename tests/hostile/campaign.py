"""Try hostile inputs of all kinds for as long as one likes, and tell what came of them in figures.

    python tests/hostile/campaign.py [--trials N | --minutes M] [--seed S] [--report FILE] [KIND ...]
    python tests/hostile/campaign.py --again FOLDER

Each input has to be refused in lines that name the place, or to work. What was neither is a violation: its input, its
story and what happened are kept in a folder below ``runs/hostile``, which ``--again`` tries once more. The same seed
gives the same inputs. Exit code 1 if there was a violation.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

from kinds import KINDS, make_kind  # noqa: E402
from pool import Figures, Found, Worker, run_kind  # noqa: E402
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: E402
from worker import INPUT  # noqa: E402

from sffr_gym.config.files import write_whole  # noqa: E402

ROOT = Path(__file__).parents[2]
OUT = ROOT / "runs" / "hostile"
SIGNATURE = re.compile(
    r"'[^']*'|\"[^\"]*\"|/[^ :]*/|\b0x[0-9a-f]+|[-+]?\d[\d.,e+-]*"
)  # what differs from one to the next


def report(done: Sequence[Figures], command: str) -> str:
    """Return the figures as Markdown."""
    head = "| kind | trials | refused | worked | violations | slowest [s] | most memory [MB] | took [s] |"
    rows = [
        f"| {each.kind} | {each.trials:,} | {each.refused:,} | {each.worked:,} | {len(each.found):,} "
        f"| {each.slowest:.1f} | {each.memory / 1e6:,.0f} | {each.elapsed:,.0f} |"
        for each in done
    ]
    lines = [
        f"`{command}` on {platform.machine()}, {os.cpu_count()} processors, Python {platform.python_version()}:", "",
        head, "|---|" + "--:|" * 7, *rows, "",
    ]  # fmt: skip
    for each in done:
        if each.counts:
            counted = ", ".join(f"{name} {count:,}" for name, count in sorted(each.counts.items()))
            lines += [f"{each.kind}: {counted}.", ""]
    for each in done:
        if each.found:
            lines += [f"## Violations of {each.kind}", "", *_violations(each.found), ""]
    return "\n".join(lines)


def _violations(found: Sequence[Found]) -> list[str]:
    """Return a line for each sort of violation, the most frequent first."""
    sorts: dict[str, list[Found]] = defaultdict(list)
    for each in found:
        sorts[SIGNATURE.sub("*", each.error)[:160]].append(each)
    lines = []
    for own in sorted(sorts.values(), key=len, reverse=True):
        error, story = (" ".join(text.split()).replace("`", "'") for text in (own[0].error, own[0].story))
        lines.append(f"- {len(own)} x `{error[:400]}`; such as `{story[:200]}` ({own[0].folder.name})")
    return lines


def again(folder: Path) -> int:
    """Try a kept input once more."""
    name = folder.name.rpartition("-")[0]
    kind = make_kind(name)
    with tempfile.TemporaryDirectory(prefix="hostile-") as scratch:
        exemplars = Path(scratch) / "exemplars"
        exemplars.mkdir()
        kind.make_exemplars(exemplars)
        worker = Worker(kind, exemplars, Path(scratch) / "worker")
        for message in worker.messages({"input": str((folder / INPUT).resolve())}):
            print(json.dumps(message, indent=2))
        worker.stop()
    return 0


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"{', '.join(KINDS)}; all without")
    parser.add_argument("--trials", type=int, metavar="N", help="of each kind; without it and --minutes 100")
    parser.add_argument("--minutes", type=float, metavar="M", help="for all kinds together")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the inputs")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes side by side")
    parser.add_argument("--report", type=Path, metavar="FILE", help="write the figures there, as Markdown")
    parser.add_argument("--again", type=Path, metavar="FOLDER", help="of a violation that is tried once more")
    asked = parser.parse_args(arguments)
    if unknown := set(asked.kinds) - KINDS.keys():
        parser.error(f"no such kind: {', '.join(sorted(unknown))}; known: {', '.join(KINDS)}")
    if asked.minutes is None and asked.trials is None:
        asked.trials = 100
    asked.kinds = asked.kinds or list(KINDS)
    return asked


def run(
    kinds: Sequence[str], *, trials: int | None, minutes: float | None = None, seed: int = 0, workers: int = 2,
    failures: Path = OUT, quiet: bool = False,
) -> list[Figures]:  # fmt: skip
    """Try inputs of kinds, one kind after the other, and return the figures of each."""
    columns = TextColumn("{task.description}"), BarColumn(20), MofNCompleteColumn(), TimeElapsedColumn()
    done = []
    with (
        tempfile.TemporaryDirectory(prefix="hostile-", ignore_cleanup_errors=True) as scratch,
        Progress(*columns, disable=quiet) as bar,
    ):
        for name in kinds:
            for old in failures.glob(f"{name}-*"):
                shutil.rmtree(old)
            task = bar.add_task(name, total=trials)
            until = None if minutes is None else time.monotonic() + 60.0 * minutes / len(kinds)

            def show(figures: Figures, task: int = task) -> None:
                label = f"{figures.refused} refused, {figures.worked} worked, {len(figures.found)} violations"
                bar.update(task, completed=figures.trials, description=f"{figures.kind}: {label}")

            done.append(
                run_kind(
                    name, Path(scratch) / "exemplars", Path(scratch), failures, trials=trials, until=until,
                    first_seed=seed, workers=workers, progress=show,
                )
            )  # fmt: skip
    return done


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what was asked for, print and write the figures."""
    asked = parse(arguments)
    if asked.again:
        return again(asked.again)
    done = run(asked.kinds, trials=asked.trials, minutes=asked.minutes, seed=asked.seed, workers=asked.workers)
    text = report(done, " ".join(["python tests/hostile/campaign.py", *(arguments or sys.argv[1:])]))
    if asked.report:
        write_whole(asked.report, text.encode())
    print(text)
    return min(1, sum(len(each.found) for each in done))


if __name__ == "__main__":
    sys.exit(main())

"""A minute of the campaign, always the same trials: what is hostile is refused in lines that name the place, or works.

``make hostile`` tries as many more as one likes; ``tests/test_kills.py`` kills commands.
"""

from pathlib import Path

import pytest
from campaign import report, run

TRIALS = {  # of each kind; a worker needs some seconds to be ready, and the trials of a kind some more
    "configs": 150, "policies": 60, "checkpoints": 12, "folders": 24, "states": 80, "machines": 15, "periods": 8,
}  # fmt: skip
ALL_WORK = ("periods",)  # nothing of these need be refused


@pytest.mark.slow
@pytest.mark.parametrize("kind", TRIALS)
def test_nothing_hostile_gets_through(kind: str, tmp_path: Path) -> None:
    """No error but one for the user, no crash, no more than ten seconds, no more than a gigabyte."""
    (figures,) = run([kind], trials=TRIALS[kind], workers=1, failures=tmp_path, quiet=True)
    assert not figures.found, report([figures], f"campaign.py {kind}")
    assert figures.trials == TRIALS[kind]
    assert figures.worked > 0
    assert figures.refused > 0 or kind in ALL_WORK

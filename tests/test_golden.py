"""Results are those of the golden record: every policy, scenario and environment, and the tables of an evaluation."""

import json

import numpy as np
import pytest
from golden import GROUPS, RECORD, elementary_functions, recorded

GOLDEN = json.loads(RECORD.read_text(encoding="utf-8"))
TOLERANCE = 1.0e-6  # where elementary functions have other last bits, which a closed loop amplifies


@pytest.mark.parametrize("group", GROUPS)
def test_results_are_those_of_the_record(group):
    """Bitwise, if the machine's elementary functions have the bits that the record was made with."""
    bitwise = elementary_functions() == GOLDEN["elementary_functions"]
    with np.errstate(all="ignore"):
        found = {name: recorded(case) for name, case in GROUPS[group]()}
    assert found
    for name in found.keys() & GOLDEN["cases"].keys():
        case, golden = found[name], GOLDEN["cases"][name]
        if bitwise:
            assert case["digest"] == golden["digest"], name
        else:
            ours, theirs = (np.array(each["sample"], dtype=np.float64) for each in (case, golden))
            np.testing.assert_allclose(ours, theirs, rtol=TOLERANCE, atol=TOLERANCE, err_msg=name)
    assert not found.keys() - GOLDEN["cases"].keys(), "not recorded yet"


def test_the_record_has_every_group():
    """No case is left that nobody compares, and none is missing."""
    assert len(GOLDEN["cases"]) == 15 * (20 * 2 + 4) + 7 + 2

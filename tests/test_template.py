"""The border in front of compiled code: another form than the template's is an error that names the place."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from sffr_gym.config.template import conform


class Pair(NamedTuple):
    """Two arrays."""

    p: np.ndarray
    tick: np.ndarray


def pair(n: int = 3) -> Pair:
    """Return a pair of n numbers."""
    return Pair(np.zeros(n), np.zeros(n, dtype=np.int64))


TEMPLATE: dict[str, Any] = {
    "batch": pair(), "rng": np.random.default_rng(0), "name": "nominal", "rows": [np.zeros((2, 2))], "any": None
}  # fmt: skip


def test_the_same_form_is_returned_as_it_is() -> None:
    """Contents are not compared."""
    value = TEMPLATE | {"batch": pair()._replace(p=np.ones(3)), "any": np.zeros(7), "name": "excited"}
    assert conform(value, TEMPLATE, "state") is value


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"batch": pair(4)}, r"state\.batch\.p: must have the shape \(3,\), has \(4,\)"),
        ({"batch": pair()._replace(tick=np.zeros(3))}, r"state\.batch\.tick: must be of type int64, is float64"),
        ({"batch": pair()._replace(p=[0.0] * 3)}, r"state\.batch\.p: must be an array, is list"),
        ({"batch": tuple(pair())}, r"state\.batch: must be a Pair, is tuple"),
        ({"rng": np.random.Generator(np.random.MT19937(0))}, r"state\.rng: must be a generator of PCG64, is MT19937"),
        ({"rng": 3}, r"state\.rng: must be a generator of PCG64, is int"),
        ({"rows": []}, r"state\.rows: must have 1 entries, has 0"),
        ({"name": 3}, r"state\.name: must be of type str, is int"),
        ({"more": 3}, r"state: has 'more', which is unknown"),
    ],
)
def test_another_form_is_an_error_that_names_the_place(changes: dict[str, Any], message: str) -> None:
    """The first difference is told."""
    with pytest.raises(ValueError, match=message):
        conform(TEMPLATE | changes, TEMPLATE, "state")


def test_what_is_missing_is_named() -> None:
    """As is a value that is no mapping at all."""
    with pytest.raises(ValueError, match=r"state: has no 'rng'"):
        conform({key: value for key, value in TEMPLATE.items() if key != "rng"}, TEMPLATE, "state")
    with pytest.raises(ValueError, match=r"state: must be a mapping, is int"):
        conform(3, TEMPLATE, "state")

"""What all rooms of the workbench share: numbers, tables, optional packages, where a result is from."""

import io
import math

import pytest
from rich.console import Console

from sffr_gym import ConfigError
from sffr_gym.task.statistics import Estimate
from sffr_workbench import common
from sffr_workbench.common import extras, numbers


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (3.2797e-2, "0.0328"), (0.99961, "1.00"), (12.345, "12.3"), (612.3, "612"), (10198.4, "10198"),
     (1.5e5, "2e5"), (1.5e-5, "2e-5"), (math.nan, "-"), (math.inf, "inf")],
)  # fmt: skip
def test_numbers_have_three_digits(value, text):
    assert numbers.format_number(value) == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0, "entries", "0 entries"),
        (1.234e-12, "m", "1.2e-12 m"),
        (0.0948, "", "0.095"),
        (math.nan, "m", "none"),
        (math.inf, "", "inf"),
    ],
)
def test_errors_have_two_digits(value, unit, text):
    assert numbers.format_error(value, unit) == text


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0"), (1234.56, "1235"), (654_321.0, "654,321"), (1.5e-5, "1.5e-05"), (math.nan, "-")]
)
def test_measurements_have_four_digits(value, text):
    assert numbers.format_measurement(value) == text


def test_intervals_stand_behind_what_chance_decides():
    assert numbers.format_estimate(Estimate(1.0, 1.0, 1.0)) == "1.00"
    assert numbers.format_estimate(Estimate(1.0, 0.5, 1.5)) == "1.00 [0.500, 1.50]"
    assert numbers.format_difference(Estimate(0.1, -0.2, 0.3)) == "+0.100 [-0.200, +0.300]"


@pytest.mark.parametrize(
    ("unit", "largest", "expected"),
    [("m", 2e-6, ("µm", 1e-6)), ("J", 0.5, ("mJ", 1e-3)), ("m", 20.0, ("m", 1.0)), ("V2 s", 1e-6, ("V² s", 1.0)),
     ("m", 0.0, ("m", 1.0)), ("m", 1e-20, ("pm", 1e-12)), ("rad", math.inf, ("rad", 1.0))],
)  # fmt: skip
def test_units_take_the_prefix_that_suits(unit, largest, expected):
    name, scale = numbers.prefixed_unit(unit, largest)
    assert (name, pytest.approx(scale)) == expected


def test_markdown_tables_escape_bars_and_align_numbers():
    text = common.markdown_table(["a", "b"], [["x | y", "1"]])
    assert text.splitlines() == ["| a | b |", "| --- | ---: |", "| x \\| y | 1 |"]
    assert "---:" not in common.markdown_table(["a", "b"], [], texts=(0, 1))


def test_titles_of_terminal_tables_are_text():
    console = Console(file=io.StringIO(), width=80)
    table = common.terminal_table("of [bold]")
    table.add_column("wide enough for it")
    console.print(table)
    assert "of [bold]" in console.file.getvalue()


def test_missing_packages_are_named_with_their_extra(monkeypatch):
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name in ("av", "PIL") else name)
    common.require("video", "json")
    with pytest.raises(ConfigError, match=r"^not installed: av, PIL; pip install 'sffr-gym\[video\]'$"):
        common.require("video", "av", "json", "PIL")


def test_origin_is_told_in_words():
    assert common.describe_versions({"numpy": "2.0", "numba": None}) == "numpy 2.0"
    assert common.describe_commit(None) == "unknown"
    assert common.describe_commit({"commit": "0123456789abcdef", "dirty": False}) == "0123456789ab"
    assert common.describe_commit({"commit": "0123456789abcdef", "dirty": True}) == "0123456789ab, with changes"

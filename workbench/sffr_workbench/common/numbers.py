"""Numbers as people read them."""

from __future__ import annotations

from math import floor, inf, isfinite, isnan, log10

from sffr_gym.task.statistics import Estimate

PREFIXED = {"m", "rad", "J", "N", "N m"}  # units that take an SI prefix
PREFIXES = {0: "", -1: "m", -2: "µ", -3: "n", -4: "p"}  # by the power of a thousand


def format_number(value: float) -> str:
    """Return three significant digits, with an exponent only where the number would be too long to read."""
    if not isfinite(value):
        return "-" if isnan(value) else str(value)
    if value == 0.0:
        return "0"
    if not 1e-3 <= abs(value) < 99_999.5:
        return f"{value:.0e}".replace("e+0", "e").replace("e-0", "e-")
    value = float(f"{value:.3g}") if abs(value) < 1000.0 else value  # so that 0.9996 is 1.00
    return f"{value:.{max(0, 2 - floor(log10(abs(value))))}f}"


def format_estimate(estimate: Estimate) -> str:
    """Return a value with its interval, or alone where nothing was left to chance."""
    if estimate.low == estimate.high:
        return format_number(estimate.value)
    return f"{format_number(estimate.value)} [{format_number(estimate.low)}, {format_number(estimate.high)}]"


def format_difference(estimate: Estimate) -> str:
    """Return a signed difference with its interval."""
    value, low, high = (format_number(each) if each <= 0.0 else f"+{format_number(each)}" for each in estimate)
    return value if estimate.low == estimate.high else f"{value} [{low}, {high}]"


def format_error(value: float, unit: str) -> str:
    """Return an error or its bound with two digits, a small integer as such."""
    if isnan(value):
        return "none"
    digits = f"{value:.0f}" if float(value).is_integer() and value < 1000 else f"{value:.2g}"
    return f"{digits} {unit}".rstrip()


def format_measurement(value: float) -> str:
    """Return four significant digits, thousands separated."""
    if not isfinite(value):
        return "-"
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.4g}"
    return f"{value:,.0f}" if abs(value) >= 1e4 else f"{value:.1e}"


def plural(count: int, noun: str) -> str:
    """Return a number with a noun, which takes an s unless it is one."""
    return f"{count} {noun}{'s' * (count != 1)}"


def prefixed_unit(unit: str, largest: float) -> tuple[str, float]:
    """Return the unit with the SI prefix that suits the largest of some values, and how many plain units it is."""
    power = floor(log10(largest) / 3) if unit in PREFIXED and 0.0 < largest < inf else 0
    power = min(0, max(power, min(PREFIXES)))
    return PREFIXES[power] + unit.replace("2", "²"), 1000.0**power

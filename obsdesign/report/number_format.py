"""Numbers and units as people read them: three significant digits, thin spaces between thousands, angles in degrees."""

from __future__ import annotations

import math
import re
from decimal import ROUND_CEILING, Decimal

from obsdesign.signals import Signal

NARROW = "\u202f"  # narrow no-break space
MINUS = "\u2212"
NOTHING = "\u2013"
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def numeral(value: float, digits: int = 3) -> str:
    """Return value to `digits` significant digits; a dash for NaN, powers of ten outside 1e-4 ... 1e9."""
    if not math.isfinite(value):
        return NOTHING if math.isnan(value) else f"{MINUS if value < 0 else ''}∞"
    if value == 0:
        return "0"
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    exponent = int(power)
    if not -4 <= exponent < 9:
        return f"{mantissa} · 10{str(exponent).translate(SUPERSCRIPT)}".replace("-", MINUS).replace(" ", NARROW)
    return _group_digits(float(f"{mantissa}e{power}"), max(digits - 1 - exponent, 0))


def rounded_up(value: float, digits: int = 3) -> float:
    """Return the least number of so many digits that is not below a value: for what nothing is above."""
    if not value or not math.isfinite(value):
        return value
    exact = Decimal(repr(float(value)))
    return float(exact.quantize(Decimal(1).scaleb(exact.adjusted() - digits + 1), ROUND_CEILING))


def plain(value: float) -> str:
    """Return a value that someone chose (a duration, a radius) with all its digits."""
    whole = float(value).is_integer() and abs(value) < 1e9
    return _group_digits(value, 0) if whole else f"{value:g}".replace("-", MINUS)


def percent(share: float) -> str:
    """Return a share with its sign: 0.0389 as 3.89 %; a tiny one as below 0.001 %."""
    tiny = 0 < abs(share) < 1e-5
    return f"{'<' + NARROW + '0.001' if tiny else numeral(100 * share)}{NARROW}%"


def with_unit(value: float, signal: Signal) -> str:
    """Return a value of a signal with the unit people read it in."""
    factor, unit = display_unit(signal)
    return f"{numeral(value * factor)}{NARROW}{unit}".rstrip(NARROW)


def display_unit(signal: Signal) -> tuple[float, str]:
    """Return (factor, unit) in which people read a signal: degrees instead of radians."""
    return signal.display_unit


def typeset(text: str) -> str:
    """Return a sentence that others made, its powers of ten and minus signs set like the rest: 5.0e-01 as 0.500."""
    text = re.sub(r"\d(?:\.\d+)?e[+-]\d+", lambda match: numeral(float(match[0])), text)
    return re.sub(r"(?<![\w.])-(?=\d)", MINUS, text)


def signal_label(signal: Signal) -> str:
    """Return the name of a signal with the unit people read it in: heading [deg]."""
    return f"{signal.name} [{display_unit(signal)[1] or NOTHING}]"


def join(parts: list[str] | tuple[str, ...], last: str = "and") -> str:
    """Return a, b and c."""
    return f" {last} ".join(filter(None, [", ".join(parts[:-1]), *parts[-1:]]))


def _group_digits(value: float, decimals: int) -> str:
    return f"{value:,.{decimals}f}".replace(",", NARROW).replace("-", MINUS)

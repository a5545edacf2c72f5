"""Units that files write, as factors to the system's own."""

from __future__ import annotations

import math

from obsdesign.errors import InputError
from obsdesign.signals import Signal

_DEGREE = math.pi / 180
# unit of a system -> what else it may be written in
_FACTORS: dict[str, dict[str, float]] = {
    "s": {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "m": {"mm": 1e-3, "cm": 1e-2, "km": 1e3, "ft": 0.3048, "nmi": 1852.0},
    "m/s": {"mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1 / 3.6, "kn": 1852 / 3600, "mph": 1609.344 / 3600, "ft/s": 0.3048},
    "m/s^2": {"g": 9.80665, "cm/s^2": 1e-2},
    "rad": {"deg": _DEGREE, "mrad": 1e-3, "cdeg": _DEGREE / 100},
    "rad/s": {"deg/s": _DEGREE, "mrad/s": 1e-3, "rpm": 2 * math.pi / 60},
}


def name_and_unit(header: str) -> tuple[str, str]:
    """Return (name, unit) of a header such as "range [m]"; "" where there is no unit."""
    name, _, unit = header.partition("[")
    return name.strip(), unit.strip().rstrip("]").strip()


def factor_of(where: str, signal: Signal, unit: str) -> float:
    """Return what numbers in `unit` are multiplied by; raise InputError for a unit that is not one of the signal's."""
    own_unit = signal.unit or ("rad" if signal.is_angle else "")
    if unit in ("", own_unit) or (unit == "-" and not own_unit):
        return 1.0
    factors = _FACTORS.get(own_unit, {})
    if unit not in factors:
        accepted = ", ".join((own_unit or "no unit", *factors))
        raise InputError(f"{where}: {signal.name} is in {unit!r}: must be in one of {accepted}")
    return factors[unit]

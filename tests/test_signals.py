"""What a number means, and how people read it."""

from __future__ import annotations

import math

import pytest

from obsdesign.signals import RADIANS_PER_DEGREE, Signal


@pytest.mark.parametrize(
    ("signal", "unit"),
    [
        (Signal("heading", "rad", is_angle=True), "deg"),
        (Signal("bearing", is_angle=True), "deg"),
        (Signal("turn_rate", "rad/s"), "deg/s"),
    ],
)
def test_angles_and_their_rates_are_read_in_degrees(signal: Signal, unit: str):
    """pi is 180 degrees, and back."""
    factor, name = signal.display_unit
    assert (math.pi * factor, name) == (180.0, unit)
    assert factor * RADIANS_PER_DEGREE == pytest.approx(1.0, rel=1e-15)


def test_all_else_is_read_in_its_own_unit():
    assert Signal("x", "m").display_unit == (1.0, "m")
    assert Signal("speed", "m/s").display_unit == (1.0, "m/s")
    assert Signal("count").display_unit == (1.0, "")

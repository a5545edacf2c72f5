"""What sensors share that look at a beacon: noise that grows with range, limited range and field of view."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi
from typing import TYPE_CHECKING

from obsdesign.checks import as_pair, require_finite, require_positive, require_within
from obsdesign.errors import InputError
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.signals import Point

if TYPE_CHECKING:
    import casadi as ca

_SOFT = 0.05  # width of a gate: share of the maximum range, or of the cosine's unit
_CLOSED = 15.0  # how far outside a gate counts as closed for good, at 1e-130: its square is still a number


@dataclass(frozen=True)
class Beacon:
    """Where a beacon stands (x, y) [m], and how far above or below the sensor, or above the surface where the vehicle dives [m]."""

    place: Point
    height: float


@dataclass(frozen=True)
class AbstractBeaconSensor(AbstractSensor, ABC):
    """A sensor that looks at a beacon, or several, at the distance r.

    spread = sqrt(sigma^2 + (sigma_per_metre r)^2), the squares of all beacons added. A sample arrives with the share
    g = g_range g_view, smooth so that it can be differentiated: g_range = 1 / (1 + exp((r / max_range - 1) / 0.05)), and with b the
    beacon's angle off the sensor's nose, in the plane, g_view = 1 / (1 + exp((cos(field_of_view / 2) - cos b) / 0.05)). The sensor sits
    at position + lever_arm, turned with the heading, and r^2 = east^2 + north^2 + height^2 from there, (height + depth)^2 where the
    vehicle has a depth. Raises InputError for values outside the ranges below.
    """

    beacon: Point
    """Where the beacon stands (x, y) [m]."""
    sigma: float
    """Standard deviation of one sample at r = 0, in the output's unit ([m] or [rad]); > 0."""
    sigma_per_metre: float = field(default=0.0, kw_only=True)
    """How the standard deviation grows with the distance, in the output's unit per metre; >= 0."""
    max_range: float | None = field(default=None, kw_only=True)
    """Distance beyond which samples fail to arrive [m], > 0; None = no limit."""
    field_of_view: float | None = field(default=None, kw_only=True)
    """Whole angle about the nose outside of which samples fail to arrive [rad], in (0, 2 pi); None = no limit."""
    height: float = field(default=0.0, kw_only=True)
    """How far the beacon is above or below the sensor [m]; where the vehicle has a depth, how far above the surface."""
    lever_arm: Point = field(default=(0.0, 0.0), kw_only=True)
    """Where on the vehicle the sensor sits (forward, left) of the position [m]; anything but (0, 0) needs the state heading."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(f"{self.name}: sigma", self.sigma)
        object.__setattr__(self, "beacon", as_pair(f"{self.name}: beacon", self.beacon))
        require_within(f"{self.name}: sigma_per_metre", self.sigma_per_metre)
        object.__setattr__(self, "lever_arm", as_pair(f"{self.name}: lever_arm", self.lever_arm))
        require_finite(f"{self.name}: height", self.height)
        if self.max_range is not None:
            require_positive(f"{self.name}: max_range", self.max_range)
        if self.field_of_view is not None:
            require_positive(f"{self.name}: field_of_view", self.field_of_view)
            if self.field_of_view >= 2 * pi:
                raise InputError(f"{self.name}: field_of_view is {self.field_of_view!r}: must be below 2 pi (None = no limit)")

    @property
    @abstractmethod
    def nose(self) -> float:
        """The direction in which the sensor looks, off the vehicle's nose [rad], counter-clockwise."""

    @property
    @abstractmethod
    def beacons(self) -> tuple[Beacon, ...]:
        """All beacons that a sample needs."""

    @property
    def landmarks(self) -> tuple[Point, ...]:
        """Where the beacons stand."""
        return tuple(beacon.place for beacon in self.beacons)

    def offset(self, place: Point, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
        """Return place - sensor, east and north [m]."""
        east, north = place[0] - state["x"], place[1] - state["y"]
        if not any(self.lever_arm):
            return east, north
        arm_east, arm_north = self._arm(state["heading"])
        return east - arm_east, north - arm_north

    def _arm(self, heading: ca.SX) -> tuple[ca.SX, ca.SX]:
        """From the position to the sensor, east and north [m]."""
        import casadi as ca

        (forward, left), cosine, sine = self.lever_arm, ca.cos(heading), ca.sin(heading)
        return forward * cosine - left * sine, forward * sine + left * cosine

    def square_distance(self, beacon: Beacon, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return r^2 [m^2]."""
        east, north = self.offset(beacon.place, state)
        square, vertical = east * east + north * north, _vertical(beacon, state)
        return square if vertical is None else square + vertical**2

    def distance(self, beacon: Beacon, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return r [m]."""
        # a power, not sqrt: the verdicts know how to square it away
        return self.square_distance(beacon, state) ** 0.5

    def half_square_rate(self, beacon: Beacon, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return d/dt r^2 / 2 = r rdot [m^2/s], by the velocity of the sensor."""
        east, north = self.offset(beacon.place, state)
        x_rate, y_rate = state["x_rate"], state["y_rate"]
        if any(self.lever_arm):
            arm_east, arm_north = self._arm(state["heading"])
            x_rate, y_rate = x_rate - arm_north * state["heading_rate"], y_rate + arm_east * state["heading_rate"]
        rate = -(east * x_rate + north * y_rate)
        vertical = _vertical(beacon, state)
        return rate if vertical is None or "depth" not in state else rate + vertical * state["depth_rate"]

    def spread_with(self, sigma: float, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return sqrt(sigma^2 + sum over the beacons of (sigma_per_metre r)^2)."""
        import casadi as ca

        if not self.sigma_per_metre:
            return ca.SX(sigma)
        squares = sum(self.square_distance(beacon, state) for beacon in self.beacons)
        return ca.sqrt(sigma**2 + self.sigma_per_metre**2 * squares)

    def gate(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return the product of g_range g_view over the beacons, 1 where neither has a limit."""
        import casadi as ca

        share = ca.SX(1)
        for beacon in self.beacons:
            if self.max_range is not None:
                share *= _smooth_gate(1 - self.distance(beacon, state) / self.max_range)
            if self.field_of_view is not None:
                east, north = self.offset(beacon.place, state)
                nose = state["heading"] + self.nose if self.nose else state["heading"]
                ahead = east * ca.cos(nose) + north * ca.sin(nose)
                share *= _smooth_gate(ahead / (east * east + north * north) ** 0.5 - ca.cos(self.field_of_view / 2))
        return share


@dataclass(frozen=True)
class AbstractSingleBeacon(AbstractBeaconSensor, ABC):
    """A sensor that looks at one beacon."""

    @property
    def beacons(self) -> tuple[Beacon, ...]:
        """The beacon."""
        return (self.only_beacon,)

    @property
    def only_beacon(self) -> Beacon:
        """The beacon, at its height."""
        return Beacon(self.beacon, self.height)


@dataclass(frozen=True, kw_only=True)
class AbstractDirectionSensor(AbstractSingleBeacon, ABC):
    """A sensor that tells the direction of a beacon off its own nose."""

    mounting_angle: float = 0.0
    """How far the sensor's nose is turned from the vehicle's [rad], counter-clockwise."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(f"{self.name}: mounting_angle", self.mounting_angle)

    @property
    def nose(self) -> float:
        """The mounting angle."""
        return self.mounting_angle

    def direction(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return atan2(beacon - sensor) - heading - mounting_angle [rad]."""
        import casadi as ca

        east, north = self.offset(self.beacon, state)
        direction = ca.atan2(north, east) - state["heading"]
        return direction - self.mounting_angle if self.mounting_angle else direction


def _smooth_gate(margin: ca.SX) -> ca.SX:
    """1 / (1 + exp(-margin / 0.05)): 1/2 at margin 0; right to the last digits also far outside, where it is small."""
    import casadi as ca

    return 1 / (1 + ca.exp(-ca.fmax(margin, -_CLOSED) / _SOFT))


def _vertical(beacon: Beacon, state: Mapping[str, ca.SX]) -> ca.SX | float | None:
    """How far the beacon is above or below the sensor [m], None where it is not; heights count from the surface where a vehicle dives."""
    if "depth" in state:
        return state["depth"] + beacon.height
    return beacon.height or None

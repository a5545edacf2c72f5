"""What every format of paths holds: times, positions about an origin on Earth, headings, and which sensors are on when."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np

from obsdesign.calculus import wrap
from obsdesign.checks import all_finite, as_array
from obsdesign.errors import InputError

HEIGHT_REFERENCES = ("sea_level", "ellipsoid")
UNIX_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_ORIGIN_KEYS = ("latitude", "longitude", "altitude", "height_reference")
_LARGEST = 1e12  # of a time [s], a position [m], a heading [rad]
_KEY = "obsdesign"  # of the text that goes with a file


@dataclass(frozen=True)
class GeodeticOrigin:
    """The point on Earth that metres count from: latitude, longitude [degrees, WGS 84], altitude [m], and what the altitude counts from.

    Raises InputError for values out of range.
    """

    latitude: float
    longitude: float
    altitude: float = 0.0
    height_reference: Literal["sea_level", "ellipsoid"] = "sea_level"

    def __post_init__(self) -> None:
        for name, limit in (("latitude", 90), ("longitude", 180), ("altitude", 1e6)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= limit:
                raise InputError(f"origin: {name} is {value}: must be a number from -{limit:g} to {limit:g}")
            object.__setattr__(self, name, float(value))
        if self.height_reference not in HEIGHT_REFERENCES:
            raise InputError(f"origin: height_reference is {self.height_reference!r}: must be one of {', '.join(HEIGHT_REFERENCES)}")


@dataclass(frozen=True, eq=False)
class SensorTimes:
    """Which sensors are on when: names of S sensors, t (K+1,) [s] where K segments begin and end, chosen (K, S).

    Raises InputError for shapes that do not fit and times that do not increase.
    """

    names: tuple[str, ...]
    t: np.ndarray
    chosen: np.ndarray

    def __post_init__(self) -> None:
        t, chosen = as_array("sensors: t", self.t), as_array("sensors: chosen", self.chosen)
        if t.ndim != 1 or chosen.shape != (len(t) - 1, len(self.names)) or not all_finite(t) or (np.diff(t) <= 0).any():
            raise InputError(f"sensors: t {t.shape} and chosen {chosen.shape} do not fit: must be (K+1,), increasing, and (K, S)")
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "chosen", chosen != 0)

    def on(self, k: int) -> tuple[str, ...]:
        """Names of the sensors that are on in segment k."""
        return tuple(name for name, is_on in zip(self.names, self.chosen[k], strict=True) if is_on)

    @property
    def changes(self) -> tuple[int, ...]:
        """Segments that begin with another set of sensors than the one before; the first always."""
        return tuple(k for k in range(len(self.chosen)) if k == 0 or (self.chosen[k] != self.chosen[k - 1]).any())


@dataclass(frozen=True, eq=False)
class Track:
    """A path as files hold it: N >= 2 points in time.

    t (N,) [s] from `epoch`, increasing; position (N, 3) [m] east, north and up of the origin; heading (N,) [rad] of the nose,
    counter-clockwise from east, None where a file does not tell; origin None: metres about nowhere.
    cruise: speed [m/s] to be set, None where it is not told; through_medium: whether that is through air or water, not over ground.
    Raises InputError for values that do not fit.
    """

    t: np.ndarray
    position: np.ndarray
    heading: np.ndarray | None = None
    origin: GeodeticOrigin | None = None
    epoch: datetime = UNIX_EPOCH
    sensors: SensorTimes | None = None
    name: str = "path"
    cruise: float | None = None
    through_medium: bool = False

    def __post_init__(self) -> None:
        for name in ("t", "position") if self.heading is None else ("t", "position", "heading"):
            values = as_array(f"path: {name}", getattr(self, name))
            if not all_finite(values) or np.abs(values).max(initial=0.0) > _LARGEST:
                raise InputError(f"path: {name} has values beyond {_LARGEST:g}, or that are not finite")
            object.__setattr__(self, name, values)
        count = len(self.t)
        fits = self.position.shape == (count, 3) and (self.heading is None or self.heading.shape == (count,))
        if self.t.ndim != 1 or count < 2 or not fits:
            raise InputError(f"path: t {self.t.shape} and position {self.position.shape} do not fit: needs (N,), (N, 3), N at least 2")
        late = np.flatnonzero(np.diff(self.t) <= 0)
        if late.size:
            k = int(late[0]) + 1
            raise InputError(f"path: time {k} is {self.t[k]:g} s after {self.t[k - 1]:g} s: times must increase")

    @property
    def course(self) -> np.ndarray:
        """Direction of motion over ground (N,) [rad], counter-clockwise from east; where nothing moves, that of before."""
        steps = np.diff(self.position[:, :2], axis=0, append=np.nan)
        moves = np.append((steps[:-1] != 0).any(axis=1), False)
        angles = np.arctan2(steps[:, 1], steps[:, 0])
        last = np.maximum.accumulate(np.where(moves, np.arange(len(moves)), -1))
        first = int(np.argmax(moves)) if moves.any() else 0
        return np.where(moves.any(), angles[np.where(last < 0, first, last)], 0.0)

    @property
    def nose(self) -> np.ndarray:
        """Heading (N,) [rad], the course where the heading is not told."""
        return self.course if self.heading is None else self.heading

    @property
    def ground_speed(self) -> np.ndarray:
        """Speed over ground (N,) [m/s] from each point to the next; the last repeats the one before."""
        speeds = np.linalg.norm(np.diff(self.position, axis=0), axis=1) / np.diff(self.t)
        return np.append(speeds, speeds[-1])

    def part(self, kept: np.ndarray) -> Track:
        """Return the track of some of its points, by their indices (M,)."""
        heading = None if self.heading is None else self.heading[kept]
        return replace(self, t=self.t[kept], position=self.position[kept], heading=heading)


def sensor_changes(track: Track) -> list[tuple[int, str]]:
    """Return for each change of the sensors the first point that is reached from then on, and in words which are on."""
    sensors = track.sensors
    if sensors is None:
        return []
    points = np.minimum(np.searchsorted(track.t, sensors.t[:-1] - 1e-9), len(track.t) - 1)
    return [(int(points[k]), "on: " + (", ".join(sensors.on(k)) or "nothing")) for k in sensors.changes]


def compass_degrees(angle: np.ndarray) -> np.ndarray:
    """Return compass bearings in [0, 360) [degrees, clockwise from north] of angles [rad, counter-clockwise from east]."""
    return np.mod(90.0 - np.degrees(angle), 360.0)


def from_compass(bearing: np.ndarray) -> np.ndarray:
    """Return angles [rad, counter-clockwise from east] in (-pi, pi] of compass bearings [degrees].

    Raises InputError for one that is not finite.
    """
    wrong = np.flatnonzero(~np.isfinite(bearing))
    if wrong.size:
        raise InputError(f"heading of point {int(wrong[0])} is {float(bearing[wrong[0]])!r}: must be a finite number of degrees")
    return -wrap(-np.radians(90.0 - bearing))


def about_text(track: Track) -> str:
    """Return as one line of JSON what a format has no place of its own for: origin, epoch, sensors."""
    origin, sensors = track.origin, track.sensors
    about: dict[str, Any] = {"epoch": utc_text(track.epoch)}
    if origin is not None:
        about["origin"] = asdict(origin)
    if sensors is not None:
        about["sensors"] = {"names": list(sensors.names), "t": sensors.t.tolist(), "chosen": sensors.chosen.astype(int).tolist()}
    return json.dumps({_KEY: about}, ensure_ascii=True)


@dataclass(frozen=True, eq=False)
class About:
    """What stands beside the points of a file."""

    origin: GeodeticOrigin | None = None
    epoch: datetime = UNIX_EPOCH
    sensors: SensorTimes | None = None


def read_about(text: str | None) -> About:
    """Return what such a line says; nothing where it is none. Raises InputError for one that is broken."""
    if text is None or not text.lstrip().startswith(f'{{"{_KEY}"'):
        return About()
    try:
        about = json.loads(text)[_KEY]
        origin, sensors = about.get("origin"), about.get("sensors")
        return About(
            None if origin is None else GeodeticOrigin(**{name: origin[name] for name in _ORIGIN_KEYS}),
            read_utc(about["epoch"]),
            None if sensors is None else SensorTimes(tuple(map(str, sensors["names"])), sensors["t"], sensors["chosen"]),
        )
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError) as error:
        raise InputError(f"what stands beside the path is broken: {type(error).__name__}: {error}") from None


def utc_text(moment: datetime) -> str:
    """Return a moment in UTC with Z, to the microsecond where it is no whole second."""
    return moment.astimezone(UTC).replace(tzinfo=None).isoformat() + "Z"


def read_utc(text: str) -> datetime:
    """Return the moment of a text in ISO 8601; a time without its offset is refused. Raises ValueError."""
    moment = datetime.fromisoformat(text)
    if moment.tzinfo is None:
        raise ValueError(f"{text!r} has no offset from UTC")
    return moment.astimezone(UTC)


def times_text(track: Track) -> list[str]:
    """Return the instants of a track in UTC, rounded to microseconds. Raises InputError beyond the year 9999."""
    start = np.datetime64(track.epoch.astimezone(UTC).replace(tzinfo=None), "us")
    microseconds = np.round(track.t * 1e6)
    if not (np.abs(microseconds) < 2.5e17).all() or track.epoch.year + microseconds.max() / 3.2e13 > 9990:
        raise InputError(f"path: times up to {track.t[-1]:g} s: must end before the year 9999")
    return [text + "Z" for text in np.datetime_as_string(start + microseconds.astype("timedelta64[us]")).tolist()]


def seconds_since(epoch: datetime, texts: list[str]) -> np.ndarray:
    """Return the seconds from an epoch to moments in ISO 8601, to the microsecond. Raises InputError for what is no moment."""
    try:
        moments = [read_utc(text) - epoch for text in texts]
    except (ValueError, OverflowError, TypeError) as error:
        raise InputError(f"a time is none: {error}") from None
    return np.array([moment.days * 86400 + moment.seconds + moment.microseconds / 1e6 for moment in moments])

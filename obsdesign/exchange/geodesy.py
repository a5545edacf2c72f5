"""A track's metres as latitude, longitude and altitude, and back."""

from __future__ import annotations

import numpy as np

from obsdesign.errors import InputError
from obsdesign.exchange.track import GeodeticOrigin, Track
from obsdesign.geodesy import TangentPlane

REACH = 100_000.0  # [m] from the origin: there the plane is 8 m off along the ground


def geodetic(track: Track, what: str) -> np.ndarray:
    """Return latitude, longitude [degrees] and altitude [m] of a track's points, (N, 3).

    Points of the plane that touches the ellipsoid at the origin, looked at from straight above (TangentPlane): the path keeps its height
    above the ground. Raises InputError for a track without an origin, naming what needs it, and for points beyond REACH.
    """
    origin = track.origin
    if origin is None:
        raise InputError(f"{what} needs a place on Earth: give [place] latitude, longitude in the scenario")
    plane, up = track.position[:, :2], track.position[:, 2]
    distance = float(np.hypot(*plane.T).max())
    if distance > REACH:
        raise InputError(f"the path reaches {distance / 1000:.6g} km from its origin: must stay within {REACH / 1000:g} km")
    return np.column_stack([TangentPlane(origin.latitude, origin.longitude).to_degrees(plane), origin.altitude + up])


def local(
    latitude: np.ndarray, longitude: np.ndarray, altitude: np.ndarray, origin: GeodeticOrigin | None
) -> tuple[GeodeticOrigin, np.ndarray]:
    """Return the origin, the first point where there is none, and metres east, north and up of it, (N, 3): the inverse of geodetic.

    Raises InputError for latitudes beyond 90 or longitudes beyond 180 degrees, for values that are not finite, for points farther away
    than REACH.
    """
    _require_on_earth(latitude, longitude, altitude)
    start = GeodeticOrigin(float(latitude[0]), float(longitude[0]), float(altitude[0])) if origin is None else origin
    plane = TangentPlane(start.latitude, start.longitude).to_metres(latitude, longitude)
    distance = float(np.hypot(*plane.T).max())
    if distance > 1.01 * REACH:
        raise InputError(f"points lie {distance / 1000:.6g} km from the origin: must be within {REACH / 1000:g} km")
    return start, np.column_stack([plane, altitude - start.altitude])


def _require_on_earth(latitude: np.ndarray, longitude: np.ndarray, altitude: np.ndarray) -> None:
    for name, values, limit in (("latitude", latitude, 90.0), ("longitude", longitude, 180.0), ("altitude", altitude, 1e6)):
        wrong = np.flatnonzero(~(np.abs(values) <= limit))
        if wrong.size:
            raise InputError(f"{name} of point {int(wrong[0])} is {values[wrong[0]]!r}: must be within -{limit:g} and {limit:g}")

"""Metres about an origin to latitude and longitude, and back."""

from __future__ import annotations

import numpy as np

from obsdesign.errors import InputError
from obsdesign.exchange.track import GeodeticOrigin, Track

REACH = 100_000.0  # [m] from the origin: there a plane that touches the Earth is 4 m off along the ground


def geodetic(track: Track, what: str) -> np.ndarray:
    """Return latitude, longitude [degrees] and altitude [m] of a track's points, (N, 3).

    Points of the plane that touches the ellipsoid at the origin, looked at from straight above: the path keeps its height above the
    ground. Raises InputError for a track without an origin, naming what needs it, and for points beyond REACH.
    Source: pymap3d (M. Hirsch), enu2geodetic.
    """
    import pymap3d

    origin = track.origin
    if origin is None:
        raise InputError(f"{what} needs a place on Earth: give [place] latitude, longitude in the scenario")
    east, north, up = track.position.T
    distance = float(np.hypot(east, north).max())
    if distance > REACH:
        raise InputError(f"the path reaches {distance / 1000:.6g} km from its origin: must stay within {REACH / 1000:g} km")
    latitude, longitude, _ = pymap3d.enu2geodetic(east.copy(), north.copy(), np.zeros_like(up), origin.latitude, origin.longitude, 0.0)
    return np.column_stack([latitude, longitude, origin.altitude + up])


def local(
    latitude: np.ndarray, longitude: np.ndarray, altitude: np.ndarray, origin: GeodeticOrigin | None
) -> tuple[GeodeticOrigin, np.ndarray]:
    """Return the origin, the first point where there is none, and metres east, north and up of it, (N, 3): the inverse of geodetic.

    The normal of the ellipsoid through each point meets the plane that touches it at the origin. Raises InputError for latitudes beyond
    90 or longitudes beyond 180 degrees, for values that are not finite, for points farther away than REACH.
    """
    import pymap3d

    _require_on_earth(latitude, longitude, altitude)
    start = GeodeticOrigin(float(latitude[0]), float(longitude[0]), float(altitude[0])) if origin is None else origin
    at_origin = (start.latitude, start.longitude, 0.0)
    zeros = np.zeros_like(latitude)
    low = np.column_stack(pymap3d.geodetic2enu(latitude.copy(), longitude.copy(), zeros, *at_origin))
    high = np.column_stack(pymap3d.geodetic2enu(latitude.copy(), longitude.copy(), zeros + 1000.0, *at_origin))
    distance = float(np.linalg.norm(low, axis=1).max())
    if distance > 1.01 * REACH:
        raise InputError(f"points lie {distance / 1000:.6g} km from the origin: must be within {REACH / 1000:g} km")
    normal = high - low
    plane = low - normal * (low[:, 2] / normal[:, 2])[:, None]
    return start, np.column_stack([plane[:, :2], altitude - start.altitude])


def _require_on_earth(latitude: np.ndarray, longitude: np.ndarray, altitude: np.ndarray) -> None:
    for name, values, limit in (("latitude", latitude, 90.0), ("longitude", longitude, 180.0), ("altitude", altitude, 1e6)):
        wrong = np.flatnonzero(~(np.abs(values) <= limit))
        if wrong.size:
            raise InputError(f"{name} of point {int(wrong[0])} is {values[wrong[0]]!r}: must be within -{limit:g} and {limit:g}")

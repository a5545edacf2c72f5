"""Latitudes and longitudes as metres of the plane that touches the Earth at an origin, and back, by pymap3d."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.errors import InputError

_LEAST_COSINE = 0.1  # between the normals at the origin and at a point: 84 degrees, where the plane is ten Earth's radii away


@dataclass(frozen=True)
class TangentPlane:
    """The plane that touches the WGS 84 ellipsoid at latitude, longitude [deg]; each of its points lies straight above or below a place.

    What is written of a path and what is read of a flight use this one map, so that both agree to rounding. East and north do not depend
    on heights. A distance s along the ground is s + s^3 / (3 R^2) in the plane: 8 mm off at 10 km, 8 m at 100 km.
    """

    latitude: float
    longitude: float

    @property
    def note(self) -> str:
        """The origin in words."""
        return f"x is east and y north of latitude {self.latitude:.9g} deg, longitude {self.longitude:.9g} deg (WGS 84)"

    def to_degrees(self, position: np.ndarray) -> np.ndarray:
        """Return latitude and longitude [deg] (K, 2) of points east and north [m] (K, 2): where their plumb lines meet the ellipsoid.

        Source: pymap3d (M. Hirsch), enu2geodetic.
        """
        import pymap3d

        east, north = position.T
        latitude, longitude, _ = pymap3d.enu2geodetic(east.copy(), north.copy(), np.zeros_like(east), self.latitude, self.longitude, 0.0)
        return np.column_stack([latitude, longitude])

    def to_metres(self, latitude: np.ndarray, longitude: np.ndarray) -> np.ndarray:
        """Return metres east and north (K, 2) of latitudes and longitudes [deg] (K,): the inverse of to_degrees.

        The normal n of the ellipsoid through a place p meets the plane in p - n p_up / n_up. Raises InputError for places from which the
        plane is not seen above, on the far side of the Earth.
        """
        import pymap3d

        places = np.column_stack(
            pymap3d.geodetic2enu(latitude.copy(), longitude.copy(), np.zeros_like(latitude), self.latitude, self.longitude, 0.0)
        )
        normals = self._normals(latitude, longitude)
        far = np.flatnonzero(normals[:, 2] < _LEAST_COSINE)
        if far.size:
            k = int(far[0])
            distance, place = np.linalg.norm(places[k]) / 1000, f"latitude {latitude[k]:.9g} deg, longitude {longitude[k]:.9g} deg"
            raise InputError(f"point {k}, {place}, is {distance:.6g} km from the origin: must be on its side of the Earth")
        return (places - normals * (places[:, 2] / normals[:, 2])[:, None])[:, :2]

    def _normals(self, latitude: np.ndarray, longitude: np.ndarray) -> np.ndarray:
        """Unit normals of the ellipsoid (K, 3), east, north and up at the origin."""
        start, phi, turn = np.radians(self.latitude), np.radians(latitude), np.radians(longitude - self.longitude)
        north = np.cos(start) * np.sin(phi) - np.sin(start) * np.cos(phi) * np.cos(turn)
        up = np.sin(start) * np.sin(phi) + np.cos(start) * np.cos(phi) * np.cos(turn)
        return np.column_stack([np.cos(phi) * np.sin(turn), north, up])

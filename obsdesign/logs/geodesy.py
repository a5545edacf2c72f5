"""Latitude and longitude as metres east and north of an origin, by pymap3d."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.errors import InputError


@dataclass(frozen=True)
class Origin3D:
    """Where local metres count from: latitude and longitude [deg], height above the ellipsoid [m] (WGS 84)."""

    latitude: float
    longitude: float
    height: float = 0.0

    @property
    def note(self) -> str:
        """The origin in words."""
        place = f"latitude {self.latitude:.9g} deg, longitude {self.longitude:.9g} deg, height {self.height:g} m (WGS 84)"
        return f"x is east and y north of {place}"

    def to_local(self, where: str, latitude: np.ndarray, longitude: np.ndarray, height: np.ndarray | float = 0.0) -> np.ndarray:
        """Return (K, 2) metres east and north in the origin's tangent plane, of latitudes and longitudes (K,) [deg].

        Raises InputError for what is no latitude or longitude.
        """
        import pymap3d

        for name, values, limit in (("latitude", latitude, 90.0), ("longitude", longitude, 360.0)):
            wrong = ~(np.abs(values) <= limit)
            if wrong.any():
                value = values[int(np.argmax(wrong))]
                raise InputError(f'{where}: {name} {value:g} deg is beyond {limit:g}: is it in another unit? (unit = "1e-7 deg")')
        east, north, _ = pymap3d.geodetic2enu(
            latitude.copy(), longitude.copy(), np.broadcast_to(height, latitude.shape).copy(), self.latitude, self.longitude, self.height
        )
        return np.column_stack([east, north])

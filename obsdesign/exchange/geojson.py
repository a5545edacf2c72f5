"""GeoJSON (RFC 7946): the path as a LineString with three components, times and headings in its properties.

A path across the meridian of 180 degrees is a MultiLineString, cut there as section 3.1.9 asks for; times and headings are those of its
points without the two that each cut adds.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from obsdesign.errors import InputError
from obsdesign.exchange.abstract import AbstractFormat, Precision, numbers, read_json
from obsdesign.exchange.geodesy import geodetic, local
from obsdesign.exchange.track import Track, about_text, compass_degrees, from_compass, read_about, times_text

DECIMALS = 9  # of degrees: 0.1 mm


@dataclass(frozen=True)
class GeoJson(AbstractFormat):
    """Longitude, latitude, height; the height reference, the origin, times and headings stand in the properties of the line."""

    @property
    def suffix(self) -> str:
        """.geojson."""
        return ".geojson"

    @property
    def precision(self) -> Precision:
        """Nine decimals of degrees, four of metres."""
        return Precision(1.5e-4, 0.0, 1e-9)

    @property
    def is_mission(self) -> bool:
        """Points in time."""
        return False

    def write(self, track: Track, target: Path) -> None:
        """Write one feature for the path and one for its origin."""
        points = geodetic(track, "geojson")
        places = np.column_stack([np.round(points[:, 1], DECIMALS), np.round(points[:, 0], DECIMALS), np.round(points[:, 2], 4)])
        origin = track.origin
        properties = {
            "name": track.name,
            "height_reference": None if origin is None else origin.height_reference,
            "about": about_text(track),
            "seconds": track.t.tolist(),
            "coordTimes": times_text(track),
        }
        if track.heading is not None:
            properties["headings_deg"] = compass_degrees(track.heading).tolist()
        parts = _cut(places)
        kind, coordinates = ("LineString", parts[0]) if len(parts) == 1 else ("MultiLineString", parts)
        features = [_feature(kind, coordinates, properties)]
        if origin is not None:
            features.append(_feature("Point", [origin.longitude, origin.latitude, origin.altitude], {"name": "origin"}))
        text = json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False, separators=(",", ":"))
        target.write_text(text + "\n", encoding="utf-8")

    def parse(self, file: Path) -> Track:
        """Return the first line; a position that is null or has two components is refused."""
        document = read_json(file)
        features = document["features"] if document.get("type") == "FeatureCollection" else [document]
        lines = [feature for feature in features if feature["geometry"]["type"] in {"LineString", "MultiLineString"}]
        if not lines:
            raise InputError("has no LineString")
        geometry = lines[0]["geometry"]
        parts = geometry["coordinates"] if geometry["type"] == "MultiLineString" else [geometry["coordinates"]]
        properties = lines[0].get("properties") or {}
        places = numbers("coordinates", _join(parts))
        if places.ndim != 2 or places.shape[1] != 3:
            raise InputError("coordinates must have three components each: longitude, latitude, height")
        about = read_about(properties.get("about"))
        origin, position = local(places[:, 1], places[:, 0], places[:, 2], about.origin)
        headings = properties.get("headings_deg")
        heading = None if headings is None else from_compass(numbers("headings_deg", headings))
        t = numbers("seconds", properties["seconds"])
        return Track(t, position, heading, origin, about.epoch, about.sensors, str(properties.get("name", file.stem)))


def _cut(places: np.ndarray) -> list[list[list[float]]]:
    """Return the parts of a line (N, 3) of longitudes [degrees], latitudes and heights that do not cross the meridian of 180 degrees."""
    parts, first = [], 0
    before: list[list[float]] = []
    for k in np.flatnonzero(np.abs(np.diff(places[:, 0])) > 180):
        side = 180.0 if places[k, 0] > 0 else -180.0
        east = places[k + 1, 0] + 2 * side - places[k, 0]  # degrees to the next point, the short way
        crossing = places[k] + (side - places[k, 0]) / east * (places[k + 1] - places[k])
        latitude, height = round(float(crossing[1]), DECIMALS), round(float(crossing[2]), 4)
        parts.append([*before, *places[first : k + 1].tolist(), [side, latitude, height]])
        before, first = [[-side, latitude, height]], k + 1
    return [*parts, [*before, *places[first:].tolist()]]


def _join(parts: list[list[list[float]]]) -> list[list[float]]:
    """Return the points of lines without those at which they were cut: the last of each but the last, the first of each but the first."""
    last = len(parts) - 1
    return [point for i, part in enumerate(parts) for point in part[1 if i else 0 : len(part) - (i < last)]]


def _feature(kind: str, coordinates: list, properties: dict[str, object]) -> dict[str, object]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}

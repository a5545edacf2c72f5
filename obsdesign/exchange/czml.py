"""CZML 1.0 for Cesium: positions, attitudes and the sensors that are on, over time."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np

from obsdesign.calculus import wrap
from obsdesign.errors import InputError
from obsdesign.exchange.abstract import AbstractFormat, Precision, numbers, read_text
from obsdesign.exchange.geodesy import geodetic, local
from obsdesign.exchange.track import SensorTimes, Track, about_text, read_about, read_utc, times_text, utc_text

_POSE = 4  # numbers per point: t, longitude, latitude, height


@dataclass(frozen=True)
class Czml(AbstractFormat):
    """Seconds since an epoch with longitude, latitude and height, and unit quaternions from the body (x forward) to the Earth's axes."""

    @property
    def suffix(self) -> str:
        """.czml."""
        return ".czml"

    @property
    def precision(self) -> Precision:
        """Nine decimals of degrees, four of metres."""
        return Precision(1.5e-4, 0.0, 1e-9)

    @property
    def is_mission(self) -> bool:
        """Points in time."""
        return False

    def write(self, track: Track, target: Path) -> None:
        """Write the packets document, path and origin; where the heading is not told the nose points along the course."""
        points, ends = geodetic(track, "czml"), times_text(track.part(np.array([0, len(track.t) - 1])))
        places = np.column_stack([track.t, np.round(points[:, 1], 9), np.round(points[:, 0], 9), np.round(points[:, 2], 4)])
        span, epoch, origin = "/".join(ends), utc_text(track.epoch), track.origin
        attitudes = np.column_stack([track.t, attitude(points[:, 0], points[:, 1], track.nose)])
        path: dict[str, Any] = {
            "id": "path",
            "name": track.name,
            "availability": span,
            "position": {"epoch": epoch, "interpolationAlgorithm": "LINEAR", "cartographicDegrees": places.ravel().tolist()},
            "orientation": {"epoch": epoch, "interpolationAlgorithm": "LINEAR", "unitQuaternion": attitudes.ravel().tolist()},
            "path": {"width": 2},
            "point": {"pixelSize": 8},
        }
        if track.sensors is not None:
            path["properties"] = {"sensors_on": _intervals(track, track.sensors)}
        packets: list[dict[str, Any]] = [
            {"id": "document", "name": track.name, "version": "1.0", "description": about_text(track), "clock": {"interval": span}},
            path,
        ]
        if origin is not None:
            place = [origin.longitude, origin.latitude, origin.altitude]
            packets.append({"id": "origin", "name": "origin", "position": {"cartographicDegrees": place}, "point": {"pixelSize": 6}})
        target.write_text(json.dumps(packets, allow_nan=False, separators=(",", ":")) + "\n", encoding="utf-8")

    def parse(self, file: Path) -> Track:
        """Return the path of the first packet whose positions are many, in cartographicDegrees."""
        packets = json.loads(read_text(file))
        found = [packet for packet in packets if len(packet.get("position", {}).get("cartographicDegrees", ())) >= 2 * _POSE]
        if not found:
            raise InputError("has no packet with cartographicDegrees over time")
        moving, description = found[0], packets[0].get("description")
        about = read_about(description if isinstance(description, str) else None)
        values = numbers("cartographicDegrees", moving["position"]["cartographicDegrees"]).reshape(-1, _POSE)
        origin, position = local(values[:, 2], values[:, 1], values[:, 3], about.origin)
        epoch, quaternions = read_utc(moving["position"]["epoch"]), moving.get("orientation", {}).get("unitQuaternion")
        heading = None
        if quaternions is not None:
            rows = numbers("unitQuaternion", quaternions).reshape(-1, 5)
            if not np.array_equal(rows[:, 0], values[:, 0]):
                raise InputError("orientation and position have different times")
            heading = heading_of(rows[:, 1:])
        return Track(values[:, 0], position, heading, origin, epoch, about.sensors, str(moving.get("name", file.stem)))


def attitude(latitude: np.ndarray, longitude: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Return quaternions (N, 4), x y z w, that turn the body's axes (x forward, z up) into those fixed to the Earth.

    R = Rz(longitude + 90 deg) Rx(90 deg - latitude) Rz(heading), heading [rad] counter-clockwise from east; in Cesium's
    headingPitchRollToFixedFrame the same has the heading -heading, which is the compass bearing less 90 degrees.
    """
    a, b = np.radians(longitude) + np.pi / 2, np.pi / 2 - np.radians(latitude)
    low, high = (a - heading) / 2, (a + heading) / 2
    sine, cosine = np.sin(b / 2), np.cos(b / 2)
    return np.column_stack([sine * np.cos(low), sine * np.sin(low), cosine * np.sin(high), cosine * np.cos(high)])


def heading_of(quaternions: np.ndarray) -> np.ndarray:
    """Return headings (N,) [rad] in (-pi, pi] of such quaternions (N, 4) of level bodies."""
    x, y, z, w = quaternions.T
    return -wrap(np.arctan2(y, x) - np.arctan2(z, w))


def _intervals(track: Track, sensors: SensorTimes) -> list[dict[str, str]]:
    """Return for each stretch of equal sensors its interval and their names."""
    starts = [*sensors.changes, len(sensors.chosen)]
    moments = [utc_text(track.epoch + timedelta(seconds=float(sensors.t[k]))) for k in starts]
    return [
        {"interval": f"{first}/{last}", "string": ", ".join(sensors.on(k)) or "none"}
        for first, last, k in zip(moments, moments[1:], starts, strict=False)
    ]

"""GPX 1.1: one track, height and time at every point, speed, course and heading as extensions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from obsdesign.errors import InputError
from obsdesign.exchange.abstract import AbstractFormat, Precision, read_xml
from obsdesign.exchange.geodesy import geodetic, local
from obsdesign.exchange.track import (
    Track,
    about_text,
    compass_degrees,
    from_compass,
    read_about,
    seconds_since,
    sensor_changes,
    times_text,
)

_GPX, _OURS = "http://www.topografix.com/GPX/1/1", "https://github.com/obsdesign/obsdesign"
_HEAD = f"""<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="obsdesign" xmlns="{_GPX}" xmlns:o="{_OURS}">
<metadata><name>%s</name><desc>%s</desc></metadata>
"""
_POINT = (
    '<trkpt lat="%.9f" lon="%.9f"><ele>%.4f</ele><time>%s</time>'
    "<extensions><o:speed>%.6f</o:speed><o:course>%.6f</o:course><o:heading>%.9f</o:heading></extensions></trkpt>\n"
)


@dataclass(frozen=True)
class Gpx(AbstractFormat):
    """The path as one segment of a track, a way point where the set of sensors changes; origin and sensors as JSON in the description."""

    @property
    def suffix(self) -> str:
        """.gpx."""
        return ".gpx"

    @property
    def precision(self) -> Precision:
        """Nine decimals of degrees, four of metres; microseconds."""
        return Precision(1.5e-4, 1e-6, 1e-9)

    @property
    def is_mission(self) -> bool:
        """Points in time."""
        return False

    def write(self, track: Track, target: Path) -> None:
        """Write the track; where the heading is not told it is the course."""
        points, times = geodetic(track, "gpx"), times_text(track)
        angles = (compass_degrees(track.course), compass_degrees(track.nose))
        columns = (*(column.tolist() for column in points.T), times, track.ground_speed.tolist(), *(column.tolist() for column in angles))
        rows = [_POINT % row for row in zip(*columns, strict=True)]
        name, about = escape(track.name), escape(about_text(track))
        changes = _changes(track, points, times)
        body = ("<trk><name>", name, "</name><trkseg>\n", *rows, "</trkseg></trk>\n</gpx>\n")
        target.write_text("".join((_HEAD % (name, about), *changes, *body)), encoding="utf-8")

    def parse(self, file: Path) -> Track:
        """Return all points of all tracks of a GPX 1.1 file; height and time at every point."""
        space = {"g": _GPX, "o": _OURS}
        root = read_xml(file)
        points = root.findall("g:trk/g:trkseg/g:trkpt", space)
        if not points:
            raise InputError("has no trkpt of GPX 1.1")
        texts = [point.findtext("g:time", None, space) for point in points]
        heights = [point.findtext("g:ele", None, space) for point in points]
        if None in texts or None in heights:
            raise InputError("has points without ele or time")
        about = read_about(root.findtext("g:metadata/g:desc", None, space))
        place = np.array([[float(point.attrib["lat"]), float(point.attrib["lon"])] for point in points])
        origin, position = local(place[:, 0], place[:, 1], np.array([float(height or "") for height in heights]), about.origin)
        headings = [point.findtext("g:extensions/o:heading", None, space) for point in points]
        heading = None if None in headings else from_compass(np.array([float(text or "") for text in headings]))
        t = seconds_since(about.epoch, [str(text).strip() for text in texts])
        name = root.findtext("g:trk/g:name", None, space) or file.stem
        return Track(t, position, heading, origin, about.epoch, about.sensors, name)


def _changes(track: Track, points: np.ndarray, times: list[str]) -> list[str]:
    """Return a way point where the set of sensors that are on changes."""
    rows = []
    for i, what in sensor_changes(track):
        latitude, longitude, altitude = points[i].tolist()
        place = f'lat="{latitude:.9f}" lon="{longitude:.9f}"><ele>{altitude:.4f}</ele><time>{times[i]}</time>'
        rows.append(f"<wpt {place}<name>{escape(what)}</name></wpt>\n")
    return rows

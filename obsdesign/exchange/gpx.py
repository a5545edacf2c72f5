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
# whole tags, which are looked up several times as fast as paths of prefixes
_TRACK, _SEGMENT, _TRACK_POINT = (f"{{{_GPX}}}{tag}" for tag in ("trk", "trkseg", "trkpt"))
_TIME, _HEIGHT, _EXTENSIONS = (f"{{{_GPX}}}{tag}" for tag in ("time", "ele", "extensions"))
_HEADING = f"{{{_OURS}}}heading"
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
        root = read_xml(file)
        points = [point for track in root.findall(_TRACK) for segment in track.findall(_SEGMENT) for point in segment.findall(_TRACK_POINT)]
        if not points:
            raise InputError("has no trkpt of GPX 1.1")
        texts, heights = ([point.findtext(tag) for point in points] for tag in (_TIME, _HEIGHT))
        if None in texts or None in heights:
            raise InputError("has points without ele or time")
        about = read_about(root.findtext(f"{{{_GPX}}}metadata/{{{_GPX}}}desc"))
        place = np.array([[float(point.attrib["lat"]), float(point.attrib["lon"])] for point in points])
        origin, position = local(place[:, 0], place[:, 1], np.array([float(height or "") for height in heights]), about.origin)
        extensions = [point.find(_EXTENSIONS) for point in points]
        headings = [None if extension is None else extension.findtext(_HEADING) for extension in extensions]
        heading = None if None in headings else from_compass(np.array([float(text or "") for text in headings]))
        t = seconds_since(about.epoch, [str(text).strip() for text in texts])
        name = root.findtext(f"{_TRACK}/{{{_GPX}}}name") or file.stem
        return Track(t, position, heading, origin, about.epoch, about.sensors, name)


def _changes(track: Track, points: np.ndarray, times: list[str]) -> list[str]:
    """Return a way point where the set of sensors that are on changes."""
    rows = []
    for i, what in sensor_changes(track):
        latitude, longitude, altitude = points[i].tolist()
        place = f'lat="{latitude:.9f}" lon="{longitude:.9f}"><ele>{altitude:.4f}</ele><time>{times[i]}</time>'
        rows.append(f"<wpt {place}<name>{escape(what)}</name></wpt>\n")
    return rows

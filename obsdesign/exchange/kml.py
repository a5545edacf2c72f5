"""KML 2.2 with Google's extension: the path as a LineString and as a gx:Track with times and headings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element
from xml.sax.saxutils import escape

import numpy as np

from obsdesign.errors import InputError
from obsdesign.exchange.abstract import AbstractFormat, Precision, number_rows, read_xml
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

_KML, _GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"
_HEAD = f"""<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="{_KML}" xmlns:gx="{_GX}">
<Document><name>%s</name><description>%s</description>
"""
_POINT = (
    "<Placemark><name>%s</name>%s<Point><altitudeMode>absolute</altitudeMode>"
    "<coordinates>%.9f,%.9f,%.4f</coordinates></Point></Placemark>\n"
)


@dataclass(frozen=True)
class Kml(AbstractFormat):
    """Heights are absolute, every position has three components; a point for the origin and wherever the set of sensors changes."""

    @property
    def suffix(self) -> str:
        """.kml."""
        return ".kml"

    @property
    def precision(self) -> Precision:
        """Nine decimals of degrees, four of metres; microseconds."""
        return Precision(1.5e-4, 1e-6, 1e-9)

    @property
    def is_mission(self) -> bool:
        """Points in time."""
        return False

    def write(self, track: Track, target: Path) -> None:
        """Write the line, the track with times, and points."""
        points, times = geodetic(track, "kml"), times_text(track)
        places = np.column_stack([points[:, 1], points[:, 0], points[:, 2]])
        name = escape(track.name)
        line = ("%.9f,%.9f,%.4f\n" * len(places)) % tuple(places.ravel().tolist())
        coordinates = ("<gx:coord>%.9f %.9f %.4f</gx:coord>\n" * len(places)) % tuple(places.ravel().tolist())
        angles = ()
        if track.heading is not None:
            headings = compass_degrees(track.heading)
            headings = np.where(headings == 0, 360.0, headings)  # a column of zeros is what writers make up
            angles = (("<gx:angles>%.9f 0 0</gx:angles>\n" * len(headings)) % tuple(headings.tolist()),)
        parts = (
            _HEAD % (name, escape(about_text(track))),
            f"<Placemark><name>{name}</name><LineString><altitudeMode>absolute</altitudeMode><coordinates>\n",
            line,
            "</coordinates></LineString></Placemark>\n",
            f"<Placemark><name>{name}, with times</name><gx:Track><altitudeMode>absolute</altitudeMode>\n",
            *(f"<when>{time}</when>\n" for time in times),
            coordinates,
            *angles,
            "</gx:Track></Placemark>\n",
            *_points(track, places, times),
            "</Document>\n</kml>\n",
        )
        target.write_text("".join(parts), encoding="utf-8")

    def parse(self, file: Path) -> Track:
        """Return the first gx:Track; samples without a position are left out with their time."""
        root = read_xml(file)
        track = next(root.iter(f"{{{_GX}}}Track"), None)
        if track is None:
            raise InputError("has no gx:Track: a LineString alone has no times")
        texts = [element.text or "" for element in track.findall(f"{{{_KML}}}when")]
        places = [(element.text or "").strip() for element in track.findall(f"{{{_GX}}}coord")]
        angles = [(element.text or "").strip() for element in track.findall(f"{{{_GX}}}angles")]
        if len(texts) != len(places) or (angles and len(angles) != len(places)):
            raise InputError(f"gx:Track has {len(texts)} times, {len(places)} positions and {len(angles)} angles")
        told = [i for i, place in enumerate(places) if place]
        values = number_rows("gx:coord", [places[i] for i in told])
        if values.shape[1] != 3 or len(told) < 2:
            raise InputError("gx:coord must be at least two positions of longitude, latitude and height")
        about = read_about(root.findtext(f"{{{_KML}}}Document/{{{_KML}}}description"))
        origin, position = local(values[:, 1], values[:, 0], values[:, 2], about.origin)
        t = seconds_since(about.epoch, [texts[i].strip() for i in told])
        return Track(t, position, _headings(angles, told), origin, about.epoch, about.sensors, _name(root) or file.stem)


def _points(track: Track, places: np.ndarray, times: list[str]) -> list[str]:
    """Return the origin, and a point with its moment wherever the set of sensors changes."""
    origin = track.origin
    rows = [] if origin is None else [_POINT % ("origin", "", origin.longitude, origin.latitude, origin.altitude)]
    for i, what in sensor_changes(track):
        rows.append(_POINT % (escape(what), f"<TimeStamp><when>{times[i]}</when></TimeStamp>", *places[i].tolist()))
    return rows


def _headings(angles: list[str], told: list[int]) -> np.ndarray | None:
    """Return headings (N,) [rad]; None where there are none, or all angles are 0, as writers make them up."""
    if not angles:
        return None
    headings = number_rows("gx:angles", [angles[i] for i in told])
    return None if not headings.any() else from_compass(headings[:, 0])


def _name(root: Element) -> str | None:
    return root.findtext(f"{{{_KML}}}Document/{{{_KML}}}name")

"""Files of planners and autopilots: written and read again, read by public readers, and as those need them (one test a fact)."""

from __future__ import annotations

import json
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
import pytest
from conftest import obsdesign

import obsdesign as od
from obsdesign.exchange.czml import attitude, heading_of
from obsdesign.exchange.formats import FORMATS, format_of, read_track, write_track
from obsdesign.exchange.geodesy import geodetic, local
from obsdesign.exchange.track import GeodeticOrigin, SensorTimes, Track, compass_degrees, from_compass
from obsdesign.geodesy import TangentPlane

ZURICH = GeodeticOrigin(47.397742, 8.545594, 488.0)
TRACKS = [word for word in FORMATS if not format_of(word).is_mission]
MISSIONS = [word for word in FORMATS if format_of(word).is_mission]


def track_of(points: int, seed: int = 0, origin: GeodeticOrigin = ZURICH) -> Track:
    """A path of random turns at 20 m/s, 50 m above its origin, with two sensors."""
    random = np.random.default_rng(seed)
    t = np.cumsum(random.uniform(0.05, 0.15, points))
    heading = np.angle(np.exp(1j * np.cumsum(random.normal(0, 0.3, points))))
    steps = 2 * np.column_stack([np.cos(heading), np.sin(heading)])
    position = np.column_stack([np.cumsum(steps, axis=0), np.full(points, 50.0)])
    sensors = SensorTimes(("gps", 'odd "<&>, é'), np.linspace(t[0], t[-1], 5), np.array([[1, 0], [0, 1], [0, 1], [1, 1]]))
    return Track(t, position, heading, origin, datetime(2026, 12, 1, 9, tzinfo=UTC), sensors, "Aerosonde <in> wind", 20.0, True)


@pytest.fixture(scope="module")
def track():
    return track_of(40)


@pytest.fixture(scope="module")
def written(tmp_path_factory, track):
    """Every format, written once; missions for both autopilots."""
    folder = tmp_path_factory.mktemp("written")
    files = {word: write_track(track, word, folder / f"path{format_of(word).suffix}")[0] for word in FORMATS}
    for word in MISSIONS:
        name = f"ardupilot{format_of(word).suffix}"
        files[f"{word} ardupilot"] = write_track(track, word, folder / name, "ardupilot", (("gps", 3),))[0]
    return files


# ---------------------------------------------------------------- all formats: there and back


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("word", FORMATS)
def test_what_was_written_is_read_again_to_the_precision_of_the_format(word, seed, tmp_path):
    random = np.random.default_rng(seed)
    place = GeodeticOrigin(float(random.uniform(-89, 89)), float(random.choice([180.0, -180.0, 0.0, 120.0])), 100.0, "ellipsoid")
    path, precision = track_of(30, seed, place), format_of(word).precision
    again = read_track(write_track(path, word, tmp_path / f"path{format_of(word).suffix}", "ardupilot")[0])
    assert np.abs(again.position - path.position).max() <= precision.position
    if precision.time is not None:
        assert np.abs(again.t - path.t).max() <= precision.time
        assert again.epoch == path.epoch
    if precision.heading is not None:
        assert np.abs(np.angle(np.exp(1j * (again.heading - path.heading)))).max() <= precision.heading
    if word == "wpl":  # a row for home: eight decimals, and no word on what heights count from
        assert again.origin.latitude == pytest.approx(place.latitude, abs=5e-9)
    else:
        assert again.origin == place
        assert (again.sensors.names, again.sensors.t.tolist()) == (path.sensors.names, path.sensors.t.tolist())
        assert np.array_equal(again.sensors.chosen, path.sensors.chosen)


@pytest.mark.parametrize("word", ["csv", "npz", "tum", "bag"])
def test_metres_about_nowhere_are_written_where_the_format_has_metres(word, track, tmp_path):
    nowhere = replace(track, origin=None, sensors=None)
    again = read_track(write_track(nowhere, word, tmp_path / f"path{format_of(word).suffix}")[0])
    assert again.origin is None and again.sensors is None
    np.testing.assert_allclose(again.position, track.position, atol=1e-9)


@pytest.mark.parametrize("word", ["plan", "wpl", "kml", "gpx", "geojson", "czml"])
def test_a_format_of_places_needs_one(word, track, tmp_path):
    with pytest.raises(od.InputError, match=r"needs a place on Earth: give \[place\] latitude, longitude"):
        write_track(replace(track, origin=None), word, tmp_path / "path")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("word", FORMATS)
def test_the_same_path_gives_the_same_bytes(word, track, tmp_path):
    if word == "bag":
        pytest.skip("an SQLite file counts its changes")
    first, again = (write_track(track, word, tmp_path / name / "path")[0].read_bytes() for name in ("a", "b"))
    assert first == again


@pytest.mark.parametrize("word", FORMATS)
def test_what_is_no_such_file_is_one_message_that_names_it(word, tmp_path):
    for content in (b"", b"{}", b"\xff\xfe", b"<a/>", b"PK\x03\x04", b"[1]"):
        file = tmp_path / "odd"
        file.write_bytes(content)
        with pytest.raises(od.InputError, match=r"odd[:,] "):
            read_track(file, word)
    with pytest.raises(od.InputError, match="nowhere"):
        read_track(tmp_path / "nowhere", word)


def test_names_tell_the_format_and_others_are_refused(tmp_path):
    for name, call in (("x.docx", read_track), ("x", lambda file: write_track(track_of(3), "docx", file))):
        with pytest.raises(od.InputError, match=r"plan.*wpl.*kml.*npz|\.plan.*\.npz"):
            call(tmp_path / name)


# ---------------------------------------------------------------- geodesy


def test_metres_become_places_as_geographiclib_would_have_them_and_come_back():
    """A geodesic of s metres at azimuth a ends where the plane's point lies, to s^3 / R^2 / 3: 0.2 m at 10 km, checked by vincenty."""
    from pymap3d.vincenty import vreckon

    for bearing in (0.0, 77.0, 180.0, 300.0):
        east, north = 10_000 * math.sin(math.radians(bearing)), 10_000 * math.cos(math.radians(bearing))
        path = Track(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [east, north, 12.0]]), origin=ZURICH)
        altitude = geodetic(path, "test")[1, 2]
        expected = vreckon(ZURICH.latitude, ZURICH.longitude, 10_000.0, bearing)
        _, offset = local(np.array([expected[0]]).ravel(), np.array([expected[1]]).ravel(), np.array([500.0]), ZURICH)
        assert np.hypot(offset[0, 0] - east, offset[0, 1] - north) < 0.02
        assert altitude == 500.0  # height above ground is kept: not the plane's, which is 7.8 m too high there


@pytest.mark.parametrize(
    "place", [GeodeticOrigin(89.9, 0.0), GeodeticOrigin(0.0, 179.9999), GeodeticOrigin(-45.0, -180.0), GeodeticOrigin(10.0, 20.0, -50.0)]
)
def test_places_come_back_everywhere_on_earth(place):
    random = np.random.default_rng(0)
    position = np.column_stack([random.uniform(-5e4, 5e4, (200, 2)), random.uniform(-10, 1000, 200)])
    path = Track(np.arange(200.0), position, origin=place)
    points = geodetic(path, "test")
    assert (np.abs(points[:, 1]) <= 180).all()
    _, again = local(*points.T, place)
    np.testing.assert_allclose(again, position, atol=1e-6)


def test_seen_from_a_pole_places_lie_where_the_normals_of_the_ellipsoid_meet_the_plane():
    """Closed form: p = (N cos phi, N (1 - e^2) sin phi), normal (cos phi, sin phi), plane z = b: at b cot phi + N e^2 cos phi."""
    a, b, phi = 6378137.0, 6378137.0 * (1 - 1 / 298.257223563), np.radians([89.99, 89.0, 60.0, 20.0])
    squared = 1 - (b / a) ** 2
    distance = b / np.tan(phi) + a / np.sqrt(1 - squared * np.sin(phi) ** 2) * squared * np.cos(phi)
    for longitude in (0.0, 130.0):
        places = TangentPlane(90.0, 0.0).to_metres(np.degrees(phi), np.full(4, longitude))
        np.testing.assert_allclose(np.hypot(*places.T), distance, rtol=1e-12, atol=1e-8)
        np.testing.assert_allclose(TangentPlane(90.0, 0.0).to_degrees(places[:2])[:, 0], np.degrees(phi[:2]), atol=1e-11)


def test_a_path_that_is_flown_is_read_from_its_log_where_it_was_designed(tmp_path):
    """Places as files have them, 10 km about an origin 488 m up, mapped back by a map of topics: to 1e-6 m, at any height."""
    random = np.random.default_rng(1)
    position = np.column_stack([random.uniform(-1e4, 1e4, (50, 2)), random.uniform(0, 500, 50)])
    places = geodetic(Track(np.arange(50.0), position, origin=ZURICH), "test")
    rows = [",".join(map(repr, row)) for row in np.column_stack([np.arange(50.0), places]).tolist()]
    (tmp_path / "flight.csv").write_text("\n".join(["t [s],lat,lon,alt", *rows]) + "\n")
    (tmp_path / "map.toml").write_text(
        '[truth]\nposition = { topic = "table", fields = ["lat", "lon"], geodetic = true }\n'
        '[sensors]\ngps = { topic = "table", fields = ["lat", "lon"], geodetic = true }\n'
        '[inputs]\nspeed = { topic = "table", field = "alt" }\nturn_rate = { topic = "table", field = "alt" }\n'
        f"[origin]\nlatitude = {ZURICH.latitude}\nlongitude = {ZURICH.longitude}\n"
    )
    log = od.read_log(tmp_path / "flight.csv", od.System(od.Unicycle(), (od.GPS(1.0),)), tmp_path / "map.toml")
    np.testing.assert_allclose(log.samples.y, position[:, :2], rtol=0, atol=1e-6)


def test_places_off_the_earth_and_far_paths_are_refused():
    with pytest.raises(od.InputError, match=r"point 1, latitude -47 deg, longitude 188 deg, is 12\d{3}.* km from the origin"):
        TangentPlane(47.0, 8.0).to_metres(np.array([47.0, -47.0]), np.array([8.0, 188.0]))
    one = np.array([1.0])
    with pytest.raises(od.InputError, match=r"latitude of point 0 is .*100"):
        local(100 * one, one, one, None)
    with pytest.raises(od.InputError, match=r"latitude of point 0 is .*473977421"):
        local(473977421 * one, one, one, None)
    with pytest.raises(od.InputError, match="origin: latitude is 91"):
        GeodeticOrigin(91.0, 0.0)
    with pytest.raises(od.InputError, match="reaches 150 km from its origin"):
        geodetic(Track(np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [150e3, 0, 0]]), origin=ZURICH), "test")


def test_compass_and_angle_are_inverse_and_north_is_0():
    angles = np.linspace(-math.pi + 1e-9, math.pi, 101)
    np.testing.assert_allclose(from_compass(compass_degrees(angles)), angles, atol=1e-12)
    np.testing.assert_allclose(compass_degrees(np.array([math.pi / 2, 0.0, -math.pi / 2])), [0.0, 90.0, 180.0], atol=1e-12)


@pytest.mark.parametrize("value", ["1e400", "nan"])
@pytest.mark.parametrize(
    ("word", "before"),
    [("gpx", "<o:heading>"), ("kml", "<gx:angles>"), ("geojson", r'"headings_deg": *\[\s*')],
    ids=["gpx", "kml", "geojson"],
)
def test_a_heading_that_is_no_finite_number_is_named(word, before, value, track, tmp_path):
    """Without a warning of NumPy on the way."""
    path = tmp_path / f"path{format_of(word).suffix}"
    write_track(track, word, path)
    text, count = re.subn(rf"({before})[-+.\de]+", rf"\g<1>{value}", path.read_text(), count=1)
    assert count == 1
    path.write_text(text)
    with pytest.raises(od.InputError, match=r"(?i)heading|not valid JSON"):
        read_track(path)


def test_a_step_of_no_length_has_the_course_of_before():
    position = np.array([[0.0, 0, 0], [0, 0, 0], [0, 2, 0], [0, 2, 0], [-1, 2, 0]])
    path = Track(np.arange(5.0), position)
    np.testing.assert_allclose(path.course, [math.pi / 2, math.pi / 2, math.pi / 2, math.pi, math.pi])


# ---------------------------------------------------------------- tracks, by public readers


def test_kml_is_absolute_with_three_components_and_times(written, track):
    from fastkml import KML

    (document,) = KML.from_string(written["kml"].read_bytes()).features
    line, moving, origin, *_ = document.features
    for placemark in (line, moving, origin):
        assert placemark.kml_geometry.altitude_mode.value == "absolute"
    assert len(line.geometry.coords) == 40 and {len(point) for point in line.geometry.coords} == {3}
    assert origin.geometry.coords[0] == (8.545594, 47.397742, 488.0)
    items = moving.kml_geometry.track_items
    assert len(items) == 40 and items[0].coord.z == 538.0
    assert items[5].when.dt.timestamp() == pytest.approx(track.epoch.timestamp() + track.t[5], abs=1e-6)
    headings = np.array([item.angle.heading for item in items])
    np.testing.assert_allclose(headings, compass_degrees(track.heading), atol=1e-8)


def test_kml_leaves_out_samples_without_a_position_and_angles_that_are_all_0(written, tmp_path):
    text = written["kml"].read_text()
    space = "{http://www.google.com/kml/ext/2.2}"
    root = ET.fromstring(text)
    moving = next(root.iter(f"{space}Track"))
    moving.findall(f"{space}coord")[3].text = None
    for angles in moving.findall(f"{space}angles"):
        angles.text = "0 0 0"
    (tmp_path / "odd.kml").write_bytes(ET.tostring(root))
    again = read_track(tmp_path / "odd.kml")
    assert len(again.t) == 39 and again.heading is None


def test_a_path_due_north_keeps_its_heading_in_kml(tmp_path):
    """Compass 0 is written as 360: a column of zeros is what writers make up."""
    north = Track(np.arange(3.0), np.array([[0.0, 0, 0], [0, 1, 0], [0, 2, 0]]), np.full(3, math.pi / 2), ZURICH)
    again = read_track(write_track(north, "kml", tmp_path / "north.kml")[0])
    np.testing.assert_allclose(again.heading, math.pi / 2, atol=1e-9)


def test_gpx_has_height_and_utc_at_every_point(written, track):
    import gpxpy

    document = gpxpy.parse(written["gpx"].read_text())
    assert document.version == "1.1"
    ((segment,),) = [each.segments for each in document.tracks]
    assert len(segment.points) == 40
    for i, point in enumerate(segment.points):
        assert point.elevation == 538.0
        assert point.time.tzinfo is not None
        assert point.time.timestamp() == pytest.approx(track.epoch.timestamp() + track.t[i], abs=1e-6)
        speed, course, heading = (float(extension.text) for extension in point.extensions)
        assert speed == pytest.approx(track.ground_speed[i], abs=1e-5)
        assert course == pytest.approx(float(compass_degrees(track.course)[i]), abs=1e-5)
        assert heading == pytest.approx(float(compass_degrees(track.heading)[i]), abs=1e-8)
    assert [point.name for point in document.waypoints] == ["on: gps", 'on: odd "<&>, é', 'on: gps, odd "<&>, é']
    assert written["gpx"].read_text().count("Z</time>") == 43


def test_a_path_across_the_date_line_is_cut_there_in_geojson(tmp_path):
    """RFC 7946, 3.1.9: no part crosses 180 degrees; the parts meet on it at one latitude, between those of their neighbours."""
    x = np.linspace(-400.0, 400.0, 8)
    there_and_back = np.concatenate([x, x[::-1]])
    place = GeodeticOrigin(-17.0, 180.0, 10.0)
    position = np.column_stack([there_and_back, np.linspace(0.0, 300.0, 16), np.linspace(20.0, 50.0, 16)])
    track = Track(np.arange(16.0), position, None, place)
    (file,) = write_track(track, "geojson", tmp_path / "fiji.geojson")
    line = json.loads(file.read_text())["features"][0]["geometry"]
    assert line["type"] == "MultiLineString"
    parts = [np.array(part) for part in line["coordinates"]]
    assert [len(part) for part in parts] == [5, 10, 5]
    for part in parts:
        assert (np.abs(part[:, 0]) <= 180).all() and (np.abs(np.diff(part[:, 0])) < 1).all()
    for before, after in pairwise(parts):
        assert before[-1, 0] == -after[0, 0] and abs(after[0, 0]) == 180 and (before[-1, 1:] == after[0, 1:]).all()
        assert before[-2, 1] < before[-1, 1] < after[1, 1]
        assert before[-2, 2] < before[-1, 2] < after[1, 2]
    again = read_track(file)
    np.testing.assert_allclose(again.position, track.position, atol=2e-4)
    assert again.t.tolist() == track.t.tolist()


def test_geojson_has_three_components_with_times_and_height_reference(written, track):
    from pygeoif import shape

    line, origin = json.loads(written["geojson"].read_text())["features"]
    assert len(shape(line["geometry"]).coords) == 40
    assert {len(point) for point in line["geometry"]["coordinates"]} == {3}
    assert line["properties"]["height_reference"] == "sea_level"
    assert line["properties"]["seconds"] == track.t.tolist()
    assert len(line["properties"]["coordTimes"]) == 40
    assert shape(origin["geometry"]).coords[0] == (8.545594, 47.397742, 488.0)


@pytest.mark.parametrize(
    "coordinates", [[[8.5, 47.4, 1.0], None], [[8.5, 47.4], [8.6, 47.5]], [[8.5, 47.4, 1.0], [8.5, 47.4]], [[47.4, 98.5, 1]] * 2]
)
def test_geojson_without_positions_is_refused(coordinates, tmp_path):
    file = tmp_path / "x.geojson"
    line = {"type": "Feature", "geometry": {"type": "LineString", "coordinates": coordinates}, "properties": {"seconds": [0, 1]}}
    file.write_text(json.dumps(line))
    with pytest.raises(od.InputError, match=r"x\.geojson: "):
        read_track(file)


def test_czml_is_longitude_latitude_height_over_time(written, track):
    from czml3 import Packet

    document, path, origin = (Packet(**packet) for packet in json.loads(written["czml"].read_text()))
    assert (document.id, origin.position.cartographicDegrees.values) == ("document", [8.545594, 47.397742, 488.0])
    rows = np.array(path.position.cartographicDegrees.values).reshape(-1, 4)
    assert np.array_equal(rows[:, 0], track.t)
    points = geodetic(track, "test")
    np.testing.assert_allclose(rows[:, 1:], points[:, [1, 0, 2]], atol=1e-4)


def test_czml_attitudes_turn_the_nose_along_the_heading_in_cesiums_way():
    """The rotation of Cesium's headingPitchRollToFixedFrame, whose heading 0 points the body's x axis east and pi/2 south."""
    random = np.random.default_rng(3)
    latitude, longitude, heading = random.uniform(-89, 89, 50), random.uniform(-180, 180, 50), random.uniform(-math.pi, math.pi, 50)
    quaternions = attitude(latitude, longitude, heading)
    np.testing.assert_allclose(heading_of(quaternions), heading, atol=1e-9)
    for (x, y, z, w), phi, lam, angle in zip(quaternions, np.radians(latitude), np.radians(longitude), heading, strict=True):
        nose = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])
        up = np.array([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)])
        east, north = (
            np.array([-np.sin(lam), np.cos(lam), 0]),
            np.array([-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)]),
        )
        np.testing.assert_allclose(nose, np.cos(angle) * east + np.sin(angle) * north, atol=1e-12)
        np.testing.assert_allclose(up, [np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)], atol=1e-12)
        cesium = np.radians(compass_degrees(np.array([angle]))[0] - 90)  # compass heading less 90 degrees
        np.testing.assert_allclose(nose, np.cos(cesium) * east - np.sin(cesium) * north, atol=1e-12)


def test_tum_rows_ascend_and_are_poses(written, track):
    rows = np.loadtxt(written["tum"])
    assert rows.shape == (40, 8) and (np.diff(rows[:, 0]) > 0).all()
    np.testing.assert_allclose(rows[:, 1:4], track.position, atol=1e-9)
    np.testing.assert_allclose(2 * np.arctan2(rows[:, 6], rows[:, 7]), track.heading, atol=1e-7)
    with pytest.raises(od.InputError, match="1 ns apart"):
        write_track(replace(track, t=track.t * 1e-9), "tum", written["tum"].parent / "fast.tum")


def test_csv_and_npz_are_read_by_what_everyone_has(written, track):
    import pandas as pd

    table = pd.read_csv(written["csv"])
    assert len(table) == 40 and table["gps on"].iloc[0] == 1
    assert json.loads(table["about"].iloc[0])["obsdesign"]["origin"]["latitude"] == 47.397742
    with np.load(written["npz"], allow_pickle=False) as archive:
        assert np.array_equal(archive["position"], track.position)
        np.testing.assert_array_equal(archive["geodetic"], geodetic(track, "test"))


def test_a_bag_holds_poses_beside_the_path_at_the_times_of_the_path(written, track):
    from rosbags.highlevel import AnyReader

    with AnyReader([written["bag"]]) as bag:
        messages = [(each.topic, time, bag.deserialize(data, each.msgtype)) for each, time, data in bag.messages()]
        poses = [(time, message) for topic, time, message in messages if topic == "/pose"]
        (path,) = [message for topic, _, message in messages if topic == "/path"]
        (fix,) = [message for topic, _, message in messages if topic == "/origin"]
        last = bag.end_time - 1
    assert (fix.latitude, fix.longitude, fix.altitude) == (47.397742, 8.545594, 488.0)
    assert [message.data for topic, _, message in messages if topic == "/sensors_on"] == ["gps", 'odd "<&>, é', 'gps, odd "<&>, é']
    assert len(poses) == len(path.poses) == 40 and last == poses[-1][0]
    for i, (time, pose) in enumerate(poses):
        for each in (pose, path.poses[i]):
            stamp = each.header.stamp
            assert stamp.sec * 1_000_000_000 + stamp.nanosec == time
            assert [each.pose.position.x, each.pose.position.y, each.pose.position.z] == track.position[i].tolist()
            assert each.header.frame_id == "map"
        assert time == pytest.approx((track.epoch.timestamp() + track.t[i]) * 1e9, abs=500)


# ---------------------------------------------------------------- missions, by MAVSDK and pymavlink


@pytest.fixture(scope="module")
def importers():
    """MAVSDK's importers near a PX4 and near an ArduPilot that send heartbeats."""
    from mavsdk.autopilot import Autopilot
    from mavsdk.component_type import ComponentType
    from mavsdk.mavsdk import Configuration, Mavsdk
    from mavsdk.plugins.mission_raw.mission_raw import MissionRaw
    from pymavlink.dialects.v20 import common

    open_ones, plugins = [], {}
    kinds = (("px4", common.MAV_AUTOPILOT_PX4, Autopilot.PX4), ("ardupilot", common.MAV_AUTOPILOT_ARDUPILOTMEGA, Autopilot.ARDUPILOT))
    for name, kind, autopilot in kinds:
        client = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        client.add_any_connection("raw://")
        link = common.MAVLink(None, srcSystem=1, srcComponent=1)
        while not any(peer.autopilot_type() == autopilot for peer in client.get_systems()):
            client.pass_received_raw_bytes(bytes(link.heartbeat_encode(common.MAV_TYPE_FIXED_WING, kind, 0, 0, 4).pack(link)))
        (system,) = client.get_systems()
        open_ones.append(client)
        plugins[name] = MissionRaw(system)
    yield plugins
    for client in open_ones:
        client.destroy()


def visited(items) -> np.ndarray:
    """Latitude, longitude [degrees], height [m] of the way points above home."""
    return np.array([[item.x / 1e7, item.y / 1e7, item.z] for item in items if item.command == 16 and item.frame == 3])


def test_a_plan_is_n_items_for_px4_and_n_and_home_for_ardupilot(importers, written, track):
    points = geodetic(track, "test")
    points[:, 2] = 50.0
    px4 = importers["px4"].import_qgroundcontrol_mission(str(written["plan"])).mission_items
    ardupilot = importers["ardupilot"].import_qgroundcontrol_mission(str(written["plan ardupilot"])).mission_items
    assert (len(px4), len(ardupilot)) == (41, 1 + 41 + 3)  # a speed; home and three changes of a relay
    assert (ardupilot[0].frame, ardupilot[0].z, ardupilot[0].x) == (5, 488.0, 473977420)
    assert [item.current for item in px4[:2]] == [1, 0] and all(item.autocontinue for item in (*px4, *ardupilot))
    for items in (px4, ardupilot):
        np.testing.assert_allclose(visited(items), points, atol=6e-8)
    speed = px4[1]
    assert (speed.command, speed.param1, speed.param2) == (178, 0.0, 20.0)  # 0: through the air
    relays = [(item.param1, item.param2) for item in ardupilot if item.command == 181]
    assert relays == [(3.0, 1.0), (3.0, 0.0), (3.0, 1.0)]
    headings = np.array([item.param4 for item in px4 if item.command == 16])
    np.testing.assert_allclose(headings, compass_degrees(track.heading), atol=0.0051)


def test_a_plan_has_fence_and_rally_points_and_agrees_with_itself(written):
    plan = json.loads(written["plan"].read_text())
    assert plan["geoFence"] == {"version": 2, "circles": [], "polygons": []}
    assert plan["rallyPoints"] == {"version": 2, "points": []}
    assert plan["mission"]["plannedHomePosition"] == [47.397742, 8.545594, 488.0]
    for item in plan["mission"]["items"]:
        if item["command"] == 16:
            assert (item["Altitude"], item["AltitudeMode"], item["frame"]) == (item["params"][6], 1, 3)
            assert None not in item["params"]
    assert [item["doJumpId"] for item in plan["mission"]["items"]] == list(range(1, 42))


def test_way_points_as_text_are_read_by_both_readers_alike(importers, written, track):
    from pymavlink.mavwp import MAVWPLoader

    points = geodetic(track, "test")
    points[:, 2] = 50.0
    for name, file, extra in (("px4", written["wpl"], 1), ("ardupilot", written["wpl ardupilot"], 5)):
        text = file.read_bytes()
        assert text.startswith(b"QGC WPL 110\n") and b"\r" not in text and text.count(b"\t") == 11 * (40 + extra)
        loader = MAVWPLoader()
        loader.load(str(file))
        rows = [loader.wp(k) for k in range(loader.count())]
        assert len(rows) == 40 + extra and all(row.autocontinue == 1 for row in rows)
        np.testing.assert_allclose([[row.x, row.y, row.z] for row in rows if row.command == 16 and row.frame == 3], points, atol=1e-8)
        assert (rows[0].frame, rows[0].z) == ((0, 488.0) if name == "ardupilot" else (3, 50.0))  # home, for ArduPilot alone
        items = importers[name].import_mission_planner_mission(str(file)).mission_items
        np.testing.assert_allclose(visited(items), points, atol=6e-8)
        # MAVSDK puts a home of its own in front for ArduPilot, whatever row 0 is
        assert len(items) == 40 + extra + (name == "ardupilot")


@pytest.mark.slow
def test_an_edited_starter_becomes_files_that_public_readers_load(importers, tmp_path):
    """init, two edits, run: the points, heights, frames and home that readers load are those of the path and of the place."""
    import gpxpy
    from fastkml import KML
    from pymavlink.mavwp import MAVWPLoader

    assert obsdesign("init", "--quiet", folder=tmp_path).returncode == 0
    (file,) = tmp_path.glob("*.toml")
    text = file.read_text()
    assert text.count("latitude = 47.397742") == text.count("height = 100.0") == 1
    file.write_text(text.replace("latitude = 47.397742", "latitude = 46.5").replace("height = 100.0", "height = 120.0"))
    done = obsdesign("run", file.name, "--out", "out", "--quiet", "--export", "plan,wpl,kml,gpx", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    out = tmp_path / "out"
    assert (out / "report.html").stat().st_size > 100_000
    rows = np.genfromtxt(out / "trajectory.csv", delimiter=",", names=True)
    east, north = (rows[next(name for name in rows.dtype.names if name.startswith(start))] for start in ("x", "y"))
    place = GeodeticOrigin(46.5, 8.545594, 488.0)
    heights = np.full(len(east), 120.0)
    path = geodetic(Track(np.arange(float(len(east))), np.column_stack([east, north, heights]), None, place), "test")
    (document,) = KML.from_string((out / "path.kml").read_bytes()).features
    line = document.features[0].kml_geometry
    assert line.altitude_mode.value == "absolute"
    np.testing.assert_allclose([point[:2] for point in line.geometry.coords], path[:, [1, 0]], atol=1e-7)
    assert {point[2] for point in line.geometry.coords} == {608.0}
    ((segment,),) = [each.segments for each in gpxpy.parse((out / "path.gpx").read_text()).tracks]
    np.testing.assert_allclose([(point.latitude, point.longitude) for point in segment.points], path[:, :2], atol=1e-7)
    items = importers["px4"].import_qgroundcontrol_mission(str(out / "path.plan")).mission_items
    points = visited(items)
    assert 10 < len(points) < len(path)
    assert np.abs(points[:, None, :2] - path[None, :, :2]).max(axis=2).min(axis=1).max() < 2e-7  # each is a point of the path
    np.testing.assert_allclose(points[[0, -1], :2], path[[0, -1], :2], atol=2e-7)
    assert set(points[:, 2]) == {120.0}
    assert json.loads((out / "path.plan").read_text())["mission"]["plannedHomePosition"] == [46.5, 8.545594, 488.0]
    loader = MAVWPLoader()
    loader.load(str(out / "path.waypoints"))
    told = json.loads((out / "result.json").read_text())["way_points"]
    assert [(each["points"], each["of"]) for each in told] == [(len(points), len(path))]  # once: both missions have the same
    rows = [loader.wp(k) for k in range(loader.count())]
    np.testing.assert_allclose([[row.x, row.y, row.z] for row in rows if row.command == 16 and row.frame == 3], points, atol=1e-6)


def test_the_table_beside_a_mission_says_from_which_item_on_which_sensor_is_on(importers, written, track):
    import csv

    for autopilot, column in (("px4", 3), ("ardupilot", 4)):
        name = "plan" if autopilot == "px4" else "plan ardupilot"
        items = importers[autopilot].import_qgroundcontrol_mission(str(written[name])).mission_items
        with written[name].with_name(f"{written[name].name}.sensors.csv").open() as table:
            header, *rows = csv.reader(table)
        assert header == ["segment", "from [s]", "to [s]", "PX4 item", "ArduPilot item", "gps", 'odd "<&>, é'] or '"' in header[-1]
        for row in rows:
            item = items[int(row[column])]
            reached = max(k for k in range(40) if track.t[k] <= float(row[1]) + 1e-9)
            point = geodetic(track, "test")[reached]
            assert (item.command, item.x / 1e7) == (16, pytest.approx(point[0], abs=6e-8))


def test_px4_switches_are_actuators(tmp_path, track):
    file = write_track(track, "plan", tmp_path / "x.plan", "px4", (("gps", 2),))[0]
    items = json.loads(file.read_text())["mission"]["items"]
    assert [item["params"][:3] for item in items if item["command"] == 187] == [[None, 1.0, None], [None, -1.0, None], [None, 1.0, None]]


@pytest.mark.parametrize(
    ("switches", "message"), [((("gp", 1),), "no sensor 'gp'"), ((("gps", 7),), "switch of gps is 7: must be from 1 to 6")]
)
def test_switches_that_are_none_are_refused(switches, message, track, tmp_path):
    with pytest.raises(od.InputError, match=message):
        write_track(track, "plan", tmp_path / "x.plan", "px4", switches)


def test_way_points_in_scaled_integers_are_refused_by_name(tmp_path):
    rows = "".join(f"{k}\t0\t3\t16\t0\t0\t0\t0\t{473977421 + k}\t85455941\t50\t1\n" for k in range(3))
    (tmp_path / "x.waypoints").write_text("QGC WPL 110\n" + rows)
    with pytest.raises(od.InputError, match=r"x\.waypoints: origin: latitude is 473977421\.0: must be a number from -90"):
        read_track(tmp_path / "x.waypoints")

"""Files of every format that a log can come in: written here by the format's own library, or by hand as its documents say."""

import json
import re
import struct
from decimal import Decimal

import numpy as np
import pymap3d
import pytest
from conftest import ROOT

import obsdesign as od
from obsdesign.cli import main
from obsdesign.dynamics.simulation import readings
from obsdesign.logs.topic_map import load_topic_map
from obsdesign.study.log_setup import file_setup

BEACONS = ((60.0, 0.0), (0.0, 50.0))
SYSTEM = od.System(
    od.Unicycle(),
    (od.GPS(1.0), *(od.Range(place, 0.5, name=f"beacon_{i}") for i, place in enumerate(BEACONS)), od.Magnetometer(0.05)),
)
GPS_ONLY = od.System(od.Unicycle(), (od.GPS(1.0),))


def driven(seed=0, seconds=40.0):
    """A drive with asynchronous samples: (t, signal, value) of inputs at 10 Hz, sensors at times of their own, the true states."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.1)
    u = np.column_stack([2.0 + np.sin(t / 5), 0.3 * np.cos(t / 7)])
    path = od.simulate(SYSTEM, [1.0, -2.0, 0.4], u, 0.1)
    rows = [(t[k], name, u[k, i]) for k in range(len(t)) for i, name in enumerate(("speed", "turn_rate"))]
    times = np.sort(random.uniform(0.0, seconds, 60))
    states = np.column_stack([np.interp(times, path.t, column) for column in path.x.T])
    y = readings(SYSTEM, states[None]).y[0] + 0.1 * random.standard_normal((60, 5))
    for k, time in enumerate(times):
        names = ("gps_x", "gps_y") if k % 3 == 0 else (f"beacon_{k % 3 - 1}",) if k % 3 == 1 else ("magnetometer", "beacon_1")
        outputs = [signal.name for signal in SYSTEM.model.outputs]
        rows += [(time, name, y[k, outputs.index(name)]) for name in names]
    rows += [(path.t[k], f"truth.{name}", path.x[k, i]) for k in range(0, len(t), 20) for i, name in enumerate(("x", "y", "heading"))]
    return rows


def long_csv(file, rows, header="t [s],signal,value", time=lambda t: repr(float(t))):
    file.write_text("\n".join([header, *(",".join([time(t), name, repr(float(value))]) for t, name, value in rows)]) + "\n")
    return file


def same(first, second, tolerance=1e-12):
    """Two logs hold the same numbers."""
    for part, fields in {"inputs": ("t", "u"), "samples": ("t", "sensor", "y"), "truth": ("t", "x")}.items():
        for field in fields:
            a, b = (getattr(getattr(log, part), field) for log in (first, second))
            assert a == pytest.approx(b, rel=1e-12, abs=tolerance, nan_ok=True)
    assert first.inputs.names == second.inputs.names


def test_one_drive_in_many_hands_is_one_log(tmp_path):
    rows = driven()
    log = od.read_log(long_csv(tmp_path / "a.csv", rows), SYSTEM)
    assert log.samples.counts == {"gps": 20, "beacon_0": 20, "beacon_1": 20, "magnetometer": 20}
    assert len(log.inputs.t) == 400 and not log.notes
    order = np.random.default_rng(1).permutation(len(rows))
    same(od.read_log(long_csv(tmp_path / "shuffled.csv", [rows[i] for i in order]), SYSTEM).first(1.0), log)
    unix = od.read_log(long_csv(tmp_path / "unix.csv", rows, time=lambda t: str(1_700_000_000 + Decimal(float(t)))), SYSTEM)
    same(unix, log)
    rounded = od.read_log(long_csv(tmp_path / "rounded.csv", [(t + 1.7e9, name, value) for t, name, value in rows]), SYSTEM)
    same(rounded, log, tolerance=2e-6)
    assert unix.epoch == 1.7e9 and "times are seconds since 2023-11-14 22:13:20 UTC" in unix.notes
    degrees = {"turn_rate": "turn_rate [deg/s]", "magnetometer": "magnetometer [deg]", "truth.heading": "truth.heading [deg]"}
    written = [(t, degrees.get(name, name), np.degrees(value) if name in degrees else value) for t, name, value in rows]
    same(od.read_log(long_csv(tmp_path / "degrees.csv", written), SYSTEM), log)
    milliseconds = [
        (1000 * t, f"{name} [mm]" if name == "beacon_0" else name, value * (1000 if name == "beacon_0" else 1)) for t, name, value in rows
    ]
    same(od.read_log(long_csv(tmp_path / "ms.csv", milliseconds, "t [ms],signal,value"), SYSTEM), log)
    same(od.read_log(wide_csv(tmp_path / "wide.csv", rows), SYSTEM), log)


def wide_csv(file, rows):
    times, names = sorted({t for t, _, _ in rows}), list(dict.fromkeys(name for _, name, _ in rows))
    cells = {(t, name): repr(float(value)) for t, name, value in rows}
    lines = [",".join(["t", *names]), *(",".join([repr(float(t)), *(cells.get((t, name), "") for name in names)]) for t in times)]
    file.write_text("\n".join(lines) + "\n")
    return file


def test_dates_of_iso_8601_and_increments(tmp_path):
    (tmp_path / "a.csv").write_text(
        "time,delta.speed,delta.turn_rate [deg],gps_x,gps_y\n"
        "2024-05-01T12:00:00.500+02:00,1.0,0,,\n"
        "2024-05-01T12:00:01.500+02:00,2.0,90,3.0,4.0\n"
        "2024-05-01T10:00:02.250Z,1.5,0,5.0,6.0\n"
    )
    log = od.read_log(tmp_path / "a.csv", GPS_ONLY)
    assert log.epoch == 1714557600.0
    assert log.inputs.t == pytest.approx([0.5, 1.5, 2.25])
    assert log.inputs.increments == ("speed", "turn_rate")
    assert log.inputs.over(np.array([0.5, 1.5, 2.25])) == pytest.approx(np.array([[2.0, np.pi / 2], [2.0, 0.0]]))


def test_a_sample_may_say_how_exact_it_is(tmp_path):
    (tmp_path / "a.csv").write_text("t [s],signal,value,sigma\n0,speed,1,\n0,turn_rate,0,\n1,beacon_0 [cm],500,20\n2,beacon_1,7,\n")
    log = od.read_log(tmp_path / "a.csv", SYSTEM)
    assert log.samples.y[:, 0].tolist() == [5.0, 7.0]
    assert log.samples.sigma[0] == pytest.approx(0.2) and np.isnan(log.samples.sigma[1])
    assert "gps never answers: the file has no sample of it" in log.notes


def test_outputs_of_one_sensor_share_their_sigma(tmp_path):
    (tmp_path / "a.csv").write_text("t,signal,value,sigma\n0,speed,1,\n0,turn_rate,0,\n1,gps_x,5,\n1,gps_y,6,0.3\n2,gps_x,5,\n2,gps_y,6,\n")
    assert od.read_log(tmp_path / "a.csv", GPS_ONLY).samples.sigma == pytest.approx([0.3, np.nan], nan_ok=True)


def test_nanoseconds_of_unix_time_are_not_lost(tmp_path):
    """A double of 1.7e18 ns is a multiple of 256 of them; what the digits say is 123 ns and 1 ns behind the tenths."""
    rows = [f"17000000001{k}000{tail},gps_{axis},1" for k, tail in ((0, "0123"), (1, "0001")) for axis in "xy"]
    (tmp_path / "a.csv").write_text(
        "\n".join(["t [ns],signal,value", "1700000000000000000,speed,1", "1700000000000000000,turn_rate,0", *rows])
    )
    log = od.read_log(tmp_path / "a.csv", GPS_ONLY)
    assert log.samples.t == pytest.approx([0.100000123, 0.110000001], abs=1e-15)
    assert log.epoch == 1.7e9


def test_what_stands_there_twice_is_left_out_in_any_order(tmp_path):
    for order in ("5 5 6", "5 6 5", "6 5 5"):
        rows = "".join(f"1,beacon_0,{value}\n" for value in order.split())
        (tmp_path / "a.csv").write_text("t,signal,value\n0,speed,1\n0,turn_rate,0\n" + rows)
        assert sorted(od.read_log(tmp_path / "a.csv", SYSTEM).samples.y[:, 0]) == [5.0, 6.0]


HEADER = "t [s],signal,value\n0,speed,1\n0,turn_rate,0\n"
BAD = {
    "times go backwards": ("t,speed,turn_rate,beacon_0\n0,1,0,5\n2,1,0,5\n1,1,0,5\n", r"line 4, column 't': 1 s comes after 2 s"),
    "an unknown landmark": (HEADER + "1,beacon_7,5\n", r"column 'beacon_7': the system has no 'beacon_7'; did you mean 'beacon_"),
    "a range that is nan": (HEADER + "1,beacon_0,nan\n", r"line 4, column 'value': 'nan' is no finite number: leave the cell empty"),
    "no odometry": ("t,beacon_0\n1,5\n2,6\n", r"has no input 'speed': the vehicle moves by speed, turn_rate"),
    "no times": ("speed,beacon_0\n1,5\n2,6\n", "no column 't'"),
    "a wrong unit": ("t,speed [kg],turn_rate,beacon_0\n0,1,0,5\n1,1,0,5\n", r"column 'speed \[kg\]': speed is in 'kg': must be in"),
    "two values at one time": (HEADER + "0,speed,2\n1,beacon_0,5\n2,beacon_0,5\n", r"line 4, column 'speed': 2 at t = 0 s, where line 2"),
    "one sample": (HEADER + "1,beacon_0,5\n", "has one sample, at t = 1 s: a log needs at least two"),
    "no samples": (HEADER + "1,speed,5\n", "has no sample of any of the sensors"),
    "half a position": (HEADER + "1,gps_x,5\n2,gps_x,5\n", "output 'gps_y' has 0 columns"),
    "a position that stops": (HEADER + "1,gps_x,5\n1,gps_y,5\n2,gps_x,5\n", r"column 'gps_y': has no value at t = 2 s"),
    "a sigma below 0": ("t,signal,value,sigma\n0,speed,1,\n0,turn_rate,0,\n1,beacon_0,5,-1\n", "line 4, column 'sigma': -1 must be"),
    "two sigmas of one position": (
        "t,signal,value,sigma\n0,speed,1,\n0,turn_rate,0,\n1,gps_x,5,0.1\n1,gps_y,5,0.3\n",
        r"line 5, column 'gps_y': sigma is 0\.3, where line 4, column 'gps_x' has 0\.1",
    ),
    "a cell too many": (HEADER + "1,beacon_0,5,6\n", "line 4: has 4 columns: the header has 3"),
    "a word for a time": (HEADER + "soon,beacon_0,5\n", "line 4: 'soon' is no time"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_with_a_table_is_named_with_its_place(case, tmp_path):
    text, message = BAD[case]
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(od.InputError, match=message):
        od.read_log(tmp_path / "bad.csv", SYSTEM)


OFF = {
    "millimetres": (lambda name, value: 1000 * value if name == "beacon_1" else value, "column 'beacon_1': its numbers are"),
    "a speed in mm/s": (lambda name, value: 1000 * value if name == "speed" else value, "column 'speed': its numbers are"),
    "a turn rate in degrees": (lambda name, value: np.degrees(value) if name == "turn_rate" else value, r"'turn_rate': .* in degrees"),
    "a compass in degrees": (lambda name, value: np.degrees(value) if name == "magnetometer" else value, r"'magnetometer': .* degrees"),
}


@pytest.mark.parametrize("case", OFF)
def test_units_that_cannot_be_meant_are_named_with_the_column(case, tmp_path):
    change, message = OFF[case]
    rows = [(t, name, change(name, value)) for t, name, value in driven(2)]
    with pytest.raises(od.InputError, match=message):
        od.read_log(long_csv(tmp_path / "off.csv", rows), SYSTEM)


def test_noise_about_nothing_is_no_wrong_unit(tmp_path):
    """Straight on: positions across the way and turns are noise, a thousand times the truth's and a sixtieth of it."""
    random, t = np.random.default_rng(4), 0.1 * np.arange(400)
    columns = {
        "t": t, "speed": np.ones(400), "turn_rate": 0.003 * random.standard_normal(400), "gps_x": t + random.standard_normal(400),
        "gps_y": random.standard_normal(400), "truth.x": t, "truth.y": 1e-3 * (1 + 0.1 * np.sin(t)),
        "truth.heading": 0.02 * random.standard_normal(400),
    }  # fmt: skip
    rows = [",".join(columns), *(",".join(map(repr, row)) for row in np.column_stack(list(columns.values())).tolist())]
    (tmp_path / "straight.csv").write_text("\n".join(rows))
    assert od.read_log(tmp_path / "straight.csv", GPS_ONLY).samples.counts == {"gps": 400}


def test_duplicates_and_a_late_truth_are_told(tmp_path):
    rows = [row for row in driven(3) if not (row[1].startswith("truth.") and row[0] < 10)]
    log = od.read_log(long_csv(tmp_path / "twice.csv", [*rows, *rows[-3:], rows[810]]), SYSTEM)
    same(log, od.read_log(long_csv(tmp_path / "once.csv", rows), SYSTEM))
    assert any("stand there twice, first line" in note for note in log.notes)
    assert any(note.startswith("the truth starts ") for note in log.notes)


TOPICS = """
[inputs]
speed = { topic = "odom", field = "v", unit = "km/h" }
turn_rate = { topic = "odom", field = "yaw_rate", unit = "deg/s", factor = -1 }
[sensors]
gps = { topic = "gps", fields = ["lat", "lon"], geodetic = true, unit = "1e-7 deg", sigma = "eph" }
[truth]
heading = { topic = "att", field = "yaw", compass = true }
[origin]
latitude = 47.0
longitude = 8.0
"""


def topics_file(folder, prefix=""):
    file = folder / "topics.toml"
    file.write_text(TOPICS.replace('topic = "', f'topic = "{prefix}'))
    return file


def require_mapped(log):
    """What a vehicle says that drives east at 36 km/h, turning left at 1 deg/s in its own sense, 100 m north of the origin."""
    assert log.inputs.over(np.array([0.1, 0.9])) == pytest.approx(np.array([[10.0, np.radians(1.0)]]), rel=1e-6)
    assert log.samples.y == pytest.approx(np.column_stack([10.0 * log.samples.t, np.full(5, 100.0)]), abs=0.02)
    assert log.samples.sigma == pytest.approx(np.full(5, 1.5))
    assert log.truth.x[:, 0] == pytest.approx(np.zeros(5), abs=1e-6)
    assert any("x is east and y north of latitude 47 deg" in note for note in log.notes)


T = 0.25 * np.arange(5)
LAT, LON, _ = pymap3d.enu2geodetic(10.0 * T, np.full(5, 100.0), 0.0 * T, 47.0, 8.0, 0.0)
GPS_ROWS = np.column_stack([np.round(LAT * 1e7), np.round(LON * 1e7), np.full(5, 1.5)])


def ulog_bytes():
    """A ULog of three topics by the published format: header, formats, subscriptions, data."""

    def message(kind, body):
        return struct.pack("<HB", len(body), ord(kind)) + body

    formats = {"odom": "uint64_t timestamp;double v;double yaw_rate;", "gps": "uint64_t timestamp;int32_t lat;int32_t lon;float eph;",
               "att": "uint64_t timestamp;double yaw;"}  # fmt: skip
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), message("B", bytes(40))]
    parts += [message("F", f"{name}:{fields}".encode()) for name, fields in formats.items()]
    parts += [message("A", struct.pack("<BH", 0, i) + name.encode()) for i, name in enumerate(formats)]
    for k, t in enumerate(T):
        stamp = struct.pack("<Q", round(t * 1e6))
        parts.append(message("D", struct.pack("<H", 0) + stamp + struct.pack("<dd", 36.0, -1.0)))
        parts.append(message("D", struct.pack("<H", 1) + stamp + struct.pack("<iif", int(GPS_ROWS[k, 0]), int(GPS_ROWS[k, 1]), 1.5)))
        parts.append(message("D", struct.pack("<H", 2) + stamp + struct.pack("<d", np.pi / 2)))
    return b"".join(parts)


def test_a_ulog_as_pyulog_writes_it(tmp_path):
    from pyulog import ULog

    (tmp_path / "raw.ulg").write_bytes(ulog_bytes())
    ULog(str(tmp_path / "raw.ulg")).write_ulog(str(tmp_path / "log.ulg"))
    recording = od.read_recording(tmp_path / "log.ulg")
    assert list(recording.topics) == ["att", "gps", "odom"]
    assert recording.topics["odom"].rate == pytest.approx(4.0)
    require_mapped(od.read_log(tmp_path / "log.ulg", GPS_ONLY, topics_file(tmp_path)))
    with pytest.raises(od.InputError, match="PX4 ULog needs `topics`"):
        od.read_log(tmp_path / "log.ulg", GPS_ONLY)


def test_a_damaged_ulog_says_so_and_prints_nothing(tmp_path, capsys):
    (tmp_path / "log.ulg").write_bytes(ulog_bytes()[:-7])
    assert od.read_recording(tmp_path / "log.ulg").topics["odom"].rate == pytest.approx(4.0)
    damaged = bytearray(ulog_bytes())
    damaged[-40] ^= 0xFF
    (tmp_path / "log.ulg").write_bytes(bytes(damaged))
    od.read_recording(tmp_path / "log.ulg")
    (tmp_path / "log.ulg").write_bytes(ulog_bytes()[:250])
    with pytest.raises(od.InputError, match=r"log\.ulg"):
        od.read_recording(tmp_path / "log.ulg")
    assert capsys.readouterr().out == ""


def test_a_dataflash_log_of_text_and_binary(tmp_path):
    formats = {"odom": (101, "Qdd", "TimeUS,v,yaw_rate"), "gps": (102, "Qdddd", "TimeUS,lat,lon,eph,I"), "att": (103, "Qd", "TimeUS,yaw")}
    sizes = {name: 3 + 8 * len(letters) for name, (_, letters, _) in formats.items()}
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += [f"FMT, {kind}, {sizes[name]}, {name}, {letters}, {columns}" for name, (kind, letters, columns) in formats.items()]
    binary = b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    for name, (kind, letters, columns) in formats.items():
        binary += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, sizes[name], name.encode(), letters.encode(), columns.encode())
    for k, t in enumerate(T):
        rows = {"odom": (36.0, -1.0), "gps": (*GPS_ROWS[k], 0.0), "att": (np.pi / 2,)}
        for name, values in rows.items():
            lines.append(", ".join([name, str(round(t * 1e6)), *map(repr, map(float, values))]))
            binary += bytes((0xA3, 0x95, formats[name][0])) + struct.pack(f"<Q{len(values)}d", round(t * 1e6), *values)
    (tmp_path / "flight.log").write_text("\n".join(lines) + "\n")
    (tmp_path / "flight.bin").write_bytes(binary)
    for name in ("flight.log", "flight.bin"):
        require_mapped(od.read_log(tmp_path / name, GPS_ONLY, topics_file(tmp_path)))


def test_an_integral_is_no_instance_of_a_message(tmp_path):
    """The field I is a number of an instance in BARO, whole, and what a controller has integrated in PIDR, a fraction or none."""
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 101, 15, PIDR, Qf, TimeUS,I",
        "FMT, 102, 12, BARO, QB, TimeUS,I",
    ]
    lines += [f"PIDR, {k}, {value}" for k, value in enumerate(("0.5", "1.7", "nan", "-2.2"), 1)]
    lines += [f"BARO, {k}, {k % 2}" for k in range(1, 5)]
    (tmp_path / "flight.log").write_text("\n".join(lines) + "\n")
    topics = od.read_recording(tmp_path / "flight.log").topics
    assert {name: len(topic.t) for name, topic in topics.items()} == {"PIDR": 4, "BARO": 2, "BARO[1]": 2}
    assert topics["PIDR"].fields["I"] == pytest.approx([0.5, 1.7, np.nan, -2.2], nan_ok=True)


@pytest.mark.parametrize("version", [1, 2])
def test_a_bag_of_ros_as_rosbags_writes_it(version, tmp_path):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    texts = {
        "odom": "float64 v\nfloat64 yaw_rate\n",
        "gps": "std_msgs/Header header\nfloat64 lat\nfloat64 lon\nfloat64 eph\n",
        "att": "float64 yaw\n",
    }
    for name, text in texts.items():
        store.register(get_types_from_msg(text, f"demo/msg/{name.capitalize()}"))
    if version == 1:
        from rosbags.rosbag1 import Writer

        file = tmp_path / "drive.bag"
        writer, serialize = Writer(file), store.serialize_ros1
    else:
        from rosbags.rosbag2 import StoragePlugin, Writer

        file = tmp_path / "drive"
        writer, serialize = Writer(file, version=9, storage_plugin=StoragePlugin.SQLITE3), store.serialize_cdr
    kinds = {name: store.types[f"demo/msg/{name.capitalize()}"] for name in texts}
    stamp_kind, header_kind = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    start = 1_700_000_000
    with writer:
        connections = {name: writer.add_connection(f"/{name}", kinds[name].__msgtype__, typestore=store) for name in texts}
        for k, t in enumerate(T):
            recorded = start * 10**9 + round(t * 1e9)
            stamp = stamp_kind(sec=start + int(t), nanosec=round((t % 1) * 1e9))
            sequence = {"seq": k} if version == 1 else {}
            header = header_kind(stamp=stamp, frame_id="map", **sequence)
            messages = {"odom": kinds["odom"](36.0, -1.0), "gps": kinds["gps"](header, *GPS_ROWS[k]), "att": kinds["att"](np.pi / 2)}
            for name, message in messages.items():
                late = 0 if name != "gps" else 3_000_000  # recorded later than it was stamped
                writer.write(connections[name], recorded + late, serialize(message, kinds[name].__msgtype__))
    log = od.read_log(file, GPS_ONLY, topics_file(tmp_path, "/"))
    require_mapped(log)
    assert log.epoch == start


def test_a_map_of_topics_says_what_is_not_there(tmp_path):
    (tmp_path / "log.ulg").write_bytes(ulog_bytes())
    file = tmp_path / "topics.toml"
    for text, message in {
        '[inputs]\nspeed = { topic = "odm", field = "v" }': "log.ulg has no 'odm'; did you mean 'odom'",
        '[inputs]\nspeed = { topic = "odom", field = "w" }': "topic 'odom' of .* has no 'w'",
        '[inputs]\nspeed = { topik = "odom" }': "inputs.speed has no 'topik'; did you mean 'topic'",
        '[sensors]\ngps = { topic = "gps", fields = ["lat", "lon"], geodetic = true }': r'latitude 4.7\d*e\+08 deg is beyond 90',
        "[things]": "has no 'things'",
    }.items():  # fmt: skip
        file.write_text(text)
        with pytest.raises(od.InputError, match=message):
            od.read_log(tmp_path / "log.ulg", GPS_ONLY, file)


def test_a_table_of_others_by_a_map_with_two_wheels_and_several_anchors(tmp_path):
    """Speed (r + l) / 2 and turn rate (r - l) / b of wheels at a distance b, and ranges in one column beside the anchor's number."""
    rows = [
        "t_ms,right,left,anchor,range,lat,lon",
        *(f"{100 * k},{1.0 + 0.1 * k},{0.8},{k % 2},{5 + k},47.001,{8.0 + 1e-5 * k}" for k in range(6)),
    ]
    (tmp_path / "robot.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "map.toml").write_text(
        '[inputs]\nspeed = { topic = "table", fields = ["right", "left"], weights = [0.5, 0.5] }\n'
        'turn_rate = { topic = "table", fields = ["right", "left"], weights = [4, -4] }\n'
        '[sensors]\nbeacon_0 = { topic = "table", field = "range", where = { anchor = 0 } }\n'
        'beacon_1 = { topic = "table", field = "range", unit = "cm", where = { anchor = 1 } }\n'
        'gps = { topic = "table", fields = ["lat", "lon"], geodetic = true }\n'
    )
    log = od.read_log(tmp_path / "robot.csv", SYSTEM, tmp_path / "map.toml")
    assert log.inputs.u == pytest.approx(np.array([[0.9 + 0.05 * k, 4 * (0.2 + 0.1 * k)] for k in range(6)]))
    assert log.inputs.t == pytest.approx(0.1 * np.arange(6))
    names = np.array(log.samples.names)[log.samples.sensor]
    assert log.samples.y[names == "beacon_0", 0].tolist() == [5.0, 7.0, 9.0]
    assert log.samples.y[names == "beacon_1", 0] == pytest.approx([0.06, 0.08, 0.10])
    east = log.samples.y[names == "gps"]  # the first position is the origin; a degree of longitude there is 76,003 m
    assert east[:, 0] == pytest.approx(0.76003 * np.arange(6), rel=1e-3) and east[:, 1] == pytest.approx(np.zeros(6), abs=1e-5)
    assert any("x is east and y north of latitude 47.001 deg, longitude 8 deg" in note for note in log.notes)
    (tmp_path / "map.toml").write_text('[inputs]\nspeed = { topic = "table", fields = ["right", "left"], weights = [1] }\n')
    with pytest.raises(od.InputError, match=r"speed: weights is \[1\]: must be a number for each of the 2 fields"):
        od.read_log(tmp_path / "robot.csv", SYSTEM, tmp_path / "map.toml")


def test_a_sigma_is_in_the_unit_of_its_field(tmp_path):
    rows = ["t,v,w,range_mm,std_mm", *(f"{k},1,0,{5000 + k},{50 + k}" for k in range(3))]
    (tmp_path / "robot.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "map.toml").write_text(
        '[inputs]\nspeed = { topic = "table", field = "v" }\nturn_rate = { topic = "table", field = "w" }\n'
        '[sensors]\nbeacon_0 = { topic = "table", field = "range_mm", unit = "mm", factor = 2, offset = 1, sigma = "std_mm" }\n'
    )
    samples = od.read_log(tmp_path / "robot.csv", SYSTEM, tmp_path / "map.toml").samples
    assert samples.y[:, 0] == pytest.approx([11.0, 11.002, 11.004])
    assert samples.sigma == pytest.approx([0.1, 0.102, 0.104])


def ranging_arrays():
    """The layout of recorded ranging runs."""
    random = np.random.default_rng(5)
    t = np.arange(1, 200) * 0.1
    path = od.simulate(SYSTEM, [0.0, 0.0, 0.0], np.tile([2.0, 0.2], (200, 1)), 0.1)
    times = np.sort(random.uniform(0.0, 19.0, 40))
    beacon = random.integers(0, 2, 40)
    x = np.column_stack([np.interp(times, path.t, path.x[:, i]) for i in (0, 1)])
    ranges = np.column_stack([times, np.zeros(40), beacon, np.linalg.norm(x - np.array(BEACONS)[beacon], axis=1)])
    return {
        "odom": np.column_stack([t, np.full(199, 0.2), np.full(199, 0.02)]),
        "gt": np.column_stack([path.t[:200], path.x[:200]]),
        "ranges": ranges,
        "beacons": np.column_stack([[0, 1], np.array(BEACONS)]),
    }


def test_arrays_of_a_ranging_run(tmp_path):
    arrays = ranging_arrays()
    np.savez(tmp_path / "run.npz", **arrays)
    system = od.System(od.Unicycle(), tuple(od.Range(place, 0.5, name=f"beacon_{i}") for i, place in enumerate(BEACONS)))
    log = od.read_log(tmp_path / "run.npz", system)
    assert log.inputs.over(np.array([1.0, 2.0])) == pytest.approx(np.array([[2.0, 0.2]]))
    assert sum(log.samples.counts.values()) == 40
    later = {name: arrays[name] + np.eye(1, arrays[name].shape[1]) * 1.7e9 for name in ("odom", "gt", "ranges")}
    np.savez(tmp_path / "unix.npz", **{**arrays, **later})
    unix = od.read_log(tmp_path / "unix.npz", system)
    same(unix, log, tolerance=2e-6)
    assert unix.epoch == 1.7e9
    for change, message in (
        ({"ranges": np.where(np.arange(4) == 2, 7, arrays["ranges"])}, r"array 'ranges', row 0, column 2: beacon 7 is not among"),
        (
            {"ranges": np.where((np.arange(40)[:, None] == 3) & (np.arange(4) == 3), np.nan, arrays["ranges"])},
            r"row \d+, column 'beacon_\d.range'",
        ),
        ({"odom": arrays["odom"][::-1]}, r"array 'odom', row 1: t is 19.8 after 19.9"),
        ({"odom": arrays["odom"][:0]}, "has no input 'speed'"),
        ({"beacons": np.array([None, 1])}, "is no NPZ of numbers"),
        ({"beacons": np.zeros(3)}, r"array 'beacons': has shape \(3,\): must have columns t, x, y"),
        ({"gt": arrays["gt"][:, :2]}, r"array 'gt': has shape \(200, 2\): must have columns t, x, y, heading"),
        ({"odom": np.where(np.arange(199)[:, None] == 4, np.nan, arrays["odom"])}, r"array 'odom', row 4, column 0: is nan"),
    ):
        np.savez(tmp_path / "bad.npz", **{**arrays, **change})
        with pytest.raises(od.InputError, match=message):
            od.read_log(tmp_path / "bad.npz", system)


def test_what_is_wrong_with_a_ranging_run_is_named_by_the_rows_of_its_arrays(tmp_path):
    t, file = np.arange(40.0), tmp_path / "run.npz"
    arrays = {
        "odom": np.column_stack([t, np.full(40, 0.5), np.zeros(40)]),
        "gt": np.column_stack([t, 0.5 * t, np.zeros(40), np.zeros(40)]),
        "ranges": np.column_stack([t, np.zeros(40), np.where(t % 2, 3.0, 7.0), np.hypot(30 - 0.5 * t, np.where(t % 2, 10.0, -20.0))]),
        "beacons": np.array([[3.0, 30.0, 10.0], [7.0, 30.0, -20.0]]),
    }

    def changed(name, row, column, value):
        array = arrays[name].copy()
        array[row, column] = value
        return {**arrays, name: array}

    for wrong, message in (
        (changed("ranges", 21, 3, np.nan), r"row 21, column 'beacon_3\.range': \[nan\] at t = 21 s is not finite"),
        (changed("ranges", 20, 3, 1e200), r"row 20, column 'beacon_7\.range': a size of 1e\+200"),
        (changed("ranges", 20, 2, 9.0), r"array 'ranges', row 20, column 2: beacon 9 is not among the beacons 3, 7"),
        (changed("beacons", 1, 1, np.inf), r"array 'beacons', row 1: beacon 7 is at \[inf, -20\.0\]: must be finite"),
        (changed("beacons", 1, 0, 3.0), r"array 'beacons', row 1: beacon 3 stands there twice"),
        ({**arrays, "odom": arrays["odom"][:1]}, r"row 0, column 'odom\.distance': the only increment"),
    ):
        np.savez(file, **wrong)
        with pytest.raises(od.InputError, match=rf"run\.npz, {message}"):
            file_setup(file)
    file.write_bytes(b"")
    with pytest.raises(od.InputError, match="is no NPZ of numbers"):
        file_setup(file)
    np.savez(file, **{**arrays, "gt": arrays["gt"][:1]})
    assert len(file_setup(file).log.truth.t) == 1
    np.savez(file, **{**arrays, "ranges": np.repeat(arrays["ranges"], 2, axis=0)})
    assert "20 values of 'beacon_3.range' stand there twice, first row 3, column" in file_setup(file).log.notes[0]


def test_files_that_are_no_logs(tmp_path):
    for name, content in (("a.xyz", b""), ("a.npz", b"none"), ("a.ulg", b"none"), ("a.bag", b"none"), ("a.csv", b"t,speed\n")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(od.InputError, match=name):
            od.read_log(tmp_path / name, SYSTEM)
    with pytest.raises(od.InputError, match="there is no such file"):
        od.read_recording(tmp_path / "none.ulg")


def test_the_page_on_logs_shows_what_runs(tmp_path, monkeypatch, capsys):
    page = (ROOT / "docs/logs.md").read_text()
    (tmp_path / "drive.csv").write_text(re.findall(r"```csv\n(.*?)```", page, flags=re.DOTALL)[0])
    monkeypatch.chdir(tmp_path)
    exec("".join(re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)[:2]), {})  # noqa: S102
    assert "log of 1.44 s, 4 samples" in capsys.readouterr().out
    (tmp_path / "topics.toml").write_text(re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)[0])
    names = set(load_topic_map(tmp_path / "topics.toml").entries)
    assert names == {"speed", "turn_rate", "gps", "beacon_1", "truth.position", "truth.heading"}


def test_the_command_lists_what_is_in_a_file(tmp_path, capsys):
    np.savez(tmp_path / "run.npz", **ranging_arrays())
    with pytest.raises(SystemExit) as ended:
        main(["log", str(tmp_path / "run.npz"), "--json"])
    assert ended.value.code == 0
    topics = {row["topic"]: row for row in json.loads(capsys.readouterr().out)["topics"]}
    assert topics["odom"]["fields"] == ["distance", "turn"] and topics["odom"]["messages"] == 199
    with pytest.raises(SystemExit) as ended:
        main(["log", str(tmp_path / "none.ulg")])
    assert ended.value.code == 2
    assert "there is no such file" in capsys.readouterr().err

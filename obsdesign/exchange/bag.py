"""A ROS 2 bag: nav_msgs/Path, geometry_msgs/PoseStamped for every pose, the origin as sensor_msgs/NavSatFix, sensors as std_msgs/String."""

from __future__ import annotations

import contextlib
import sqlite3
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.calculus import yaw
from obsdesign.display import MissingPackageError
from obsdesign.errors import InputError
from obsdesign.exchange.abstract import MAX_BYTES, AbstractFormat, Precision
from obsdesign.exchange.track import GeodeticOrigin, Track, about_text, read_about

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_PATH, _POSE, _ORIGIN, _ABOUT, _SENSORS = "/path", "/pose", "/origin", "/about", "/sensors_on"
_FRAME = "map"
_LITTLE = b"\x00\x01\x00\x00"  # how messages in little-endian CDR begin
_POSE_DTYPE = np.dtype([("second", "<i4"), ("nanosecond", "<u4"), ("length", "<u4"), ("frame", "S4"), ("pose", "<f8", (7,))])
_MAX_SECONDS = 2**31 - 1  # that a stamp can hold
_ODD_TABLES = "SELECT name FROM sqlite_master WHERE type NOT IN ('table', 'index') OR sql LIKE '% VIRTUAL %' OR sql LIKE '% AS (%'"
_MAX_STEPS = 50_000_000  # of SQLite's machine for one question to a bag


@dataclass(frozen=True)
class RosBag(AbstractFormat):
    """A folder with metadata.yaml and an SQLite file; the time of a message is that of its stamp and of its point."""

    @property
    def suffix(self) -> str:
        """No suffix: a bag is a folder."""
        return "_bag"

    @property
    def precision(self) -> Precision:
        """Exact positions, times to the nanosecond."""
        return Precision(0.0, 1e-9, 1e-12)

    @property
    def is_mission(self) -> bool:
        """Points in time."""
        return False

    def write(self, track: Track, target: Path) -> None:
        """Write the bag; raises MissingPackageError without rosbags, InputError for times that stamps cannot hold."""
        try:
            from rosbags.rosbag2 import Writer
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise MissingPackageError("writing a bag needs rosbags: pip install 'obsdesign[ros]'") from None
        store, stamps = get_typestore(Stores.ROS2_HUMBLE), _stamps(track)
        poses = _poses(track, stamps)
        try:
            with Writer(target, version=9) as bag:
                for topic, kind, messages in _messages(store, track, stamps, poses):
                    connection = bag.add_connection(topic, kind, typestore=store)
                    for stamp, data in messages:
                        bag.write(connection, stamp, data)
        except sqlite3.Error as error:  # a full disk, too
            raise InputError(f"{target.name}: cannot be written: {error}") from None

    def parse(self, file: Path) -> Track:
        """Return the poses of topic /pose, or of the only topic of that kind; the bag must be stored as SQLite, not packed."""
        stores = sorted(file.glob("*.db3")) if file.is_dir() else []
        if len(stores) != 1:
            raise InputError(f"has {len(stores)} files that end in .db3: must be the folder of a bag with one, not packed")
        if stores[0].stat().st_size > MAX_BYTES:
            raise InputError(f"{stores[0].name} has more than {MAX_BYTES} bytes")
        try:
            with contextlib.closing(sqlite3.connect(f"{stores[0].absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
                stamps, poses, about = _read(database)
        except (sqlite3.Error, sqlite3.Warning) as error:
            raise InputError(f"{stores[0].name}: {error}") from None
        if not (np.abs(poses[:, 3:]) <= 2).all():
            raise InputError("has a quaternion that is not of length 1")
        beside = read_about(about)
        start = int(beside.epoch.timestamp())
        t = (stamps[:, 0] - start) + stamps[:, 1] * 1e-9 - beside.epoch.microsecond / 1e6
        return Track(t, poses[:, :3], yaw(*poses[:, 3:].T), beside.origin, beside.epoch, beside.sensors, file.name)


def _stamps(track: Track) -> np.ndarray:
    """Return seconds and nanoseconds (N, 2) since 1970."""
    start = track.epoch.timestamp()
    whole, part = np.divmod(np.round(track.t * 1e9).astype(np.int64) + round((start % 1) * 1e9), 1_000_000_000)
    seconds = whole + int(start // 1)
    if seconds.min() < 0 or seconds.max() > _MAX_SECONDS or np.abs(track.t).max() > 4e9:
        raise InputError("path: times in a bag must lie from 1970 to 2038")
    stamps = np.column_stack([seconds, part])
    if (np.diff(seconds * 1_000_000_000 + part) <= 0).any():
        raise InputError("path: times in a bag must be at least 1 ns apart")
    return stamps


def _poses(track: Track, stamps: np.ndarray) -> np.ndarray:
    """Return the poses as CDR lays them out: stamp, frame, position, orientation; 72 bytes each."""
    poses = np.zeros(len(stamps), _POSE_DTYPE)
    poses["second"], poses["nanosecond"] = stamps.T
    poses["length"], poses["frame"] = len(_FRAME) + 1, _FRAME.encode()
    poses["pose"][:, :3] = track.position
    poses["pose"][:, 5], poses["pose"][:, 6] = np.sin(track.nose / 2), np.cos(track.nose / 2)
    return poses


def _path_data(stamps: np.ndarray, poses: np.ndarray) -> bytes:
    """Return nav_msgs/Path in CDR: the first pose begins at an odd multiple of 4 bytes, so that 4 of padding precede its numbers."""
    second, nanosecond = stamps[0].tolist()
    frame = _FRAME.encode() + b"\x00"
    head = struct.pack("<iII", second, nanosecond, len(frame)) + frame + struct.pack("<I", len(poses))
    first = poses[:1].tobytes()
    return b"".join((_LITTLE, head, first[:16], b"\x00" * 4, first[16:], poses[1:].tobytes()))


def _messages(store: Typestore, track: Track, stamps: np.ndarray, poses: np.ndarray) -> list[tuple[str, str, list[tuple[int, bytes]]]]:
    """Return topic, type, and times with data of all messages."""
    times, size, packed = (stamps @ [1_000_000_000, 1]).tolist(), _POSE_DTYPE.itemsize, poses.tobytes()
    pose_messages = [(time, _LITTLE + packed[i * size : (i + 1) * size]) for i, time in enumerate(times)]
    start, sensors = times[0], track.sensors
    messages = [
        (_ABOUT, "std_msgs/msg/String", [(start, _text_data(store, about_text(track)))]),
        (_PATH, "nav_msgs/msg/Path", [(start, _path_data(stamps, poses))]),
        (_POSE, "geometry_msgs/msg/PoseStamped", pose_messages),
    ]
    if track.origin is not None:
        messages.append((_ORIGIN, "sensor_msgs/msg/NavSatFix", [(start, _fix_data(store, track.origin, stamps[0]))]))
    if sensors is not None:
        begin = round(track.epoch.timestamp() * 1e9)
        on = [(begin + round(float(sensors.t[k]) * 1e9), _text_data(store, ", ".join(sensors.on(k)))) for k in sensors.changes]
        messages.append((_SENSORS, "std_msgs/msg/String", on))
    return messages


def _text_data(store: Typestore, text: str) -> bytes:
    return bytes(store.serialize_cdr(store.types["std_msgs/msg/String"](data=text), "std_msgs/msg/String"))


def _fix_data(store: Typestore, origin: GeodeticOrigin, stamp: np.ndarray) -> bytes:
    """Return the origin as NavSatFix, of unknown covariance and no service."""
    types = store.types
    second, nanosecond = stamp.tolist()
    fix = types["sensor_msgs/msg/NavSatFix"](
        header=types["std_msgs/msg/Header"](stamp=types["builtin_interfaces/msg/Time"](sec=second, nanosec=nanosecond), frame_id=_FRAME),
        status=types["sensor_msgs/msg/NavSatStatus"](status=-1, service=0),
        latitude=origin.latitude,
        longitude=origin.longitude,
        altitude=origin.altitude,
        position_covariance=np.zeros(9),
        position_covariance_type=0,
    )
    return bytes(store.serialize_cdr(fix, "sensor_msgs/msg/NavSatFix"))


def _read(database: sqlite3.Connection) -> tuple[np.ndarray, np.ndarray, str | None]:
    """Return stamps (N, 2), poses (N, 7) and what stands beside them; tables only, no views, within a limited amount of work."""
    budget = iter(range(_MAX_STEPS // 10_000))
    database.set_progress_handler(lambda: next(budget, None) is None, 10_000)
    database.execute("PRAGMA trusted_schema = OFF")
    if (first := database.execute(_ODD_TABLES).fetchone()) is not None:
        raise InputError(f"{first[0]} is no plain table")
    topics = {name: (number, kind) for number, name, kind in database.execute("SELECT id, name, type FROM topics")}
    poses = [name for name, (_, kind) in topics.items() if kind == "geometry_msgs/msg/PoseStamped"]
    if _POSE not in poses and len(poses) != 1:
        raise InputError(f"has {len(poses)} topics of PoseStamped: must have one, or {_POSE} among them")
    blobs = _data(database, topics[_POSE if _POSE in poses else poses[0]][0])
    about = None
    if _ABOUT in topics and topics[_ABOUT][1] == "std_msgs/msg/String":
        (data,) = _data(database, topics[_ABOUT][0])
        (length,) = struct.unpack_from("<I", data, 4)
        about = data[8 : 8 + length].rstrip(b"\x00").decode()
    return *_pose_columns(blobs), about


def _data(database: sqlite3.Connection, topic: int) -> list[bytes]:
    rows = database.execute("SELECT data FROM messages WHERE topic_id = ? ORDER BY timestamp", (topic,)).fetchall()
    if not rows or not all(isinstance(row[0], bytes) and row[0][:2] == _LITTLE[:2] for row in rows):
        raise InputError("has no messages in little-endian CDR of a topic")
    return [row[0] for row in rows]


def _pose_columns(blobs: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps (N, 2) and poses (N, 7) of messages whose frames are of equal length."""
    size = len(blobs[0])
    if any(len(blob) != size for blob in blobs) or size < 4 + 12 + 56:
        raise InputError("has poses of different or too small size: must all be in one frame")
    (length,) = struct.unpack_from("<I", blobs[0], 12)
    start = 4 + -(-(12 + length) // 8) * 8  # of the numbers, which begin at a multiple of 8 after the first four bytes
    if start + 56 > size:
        raise InputError("has poses that are shorter than they say")
    rows = np.frombuffer(b"".join(blobs), np.uint8).reshape(len(blobs), size)
    stamps = np.ascontiguousarray(rows[:, 4:12]).view("<i4").astype(np.int64)
    if (rows[:, 12:16] != rows[0, 12:16]).any():
        raise InputError("has poses in frames of different length")
    return stamps, np.ascontiguousarray(rows[:, start : start + 56]).view("<f8")

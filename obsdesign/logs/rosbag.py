"""Bags of ROS 1 and ROS 2, by rosbags."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from obsdesign.errors import InputError
from obsdesign.logs.recording import Recording, Topic, missing_package

_MAX_ARRAY = 64  # entries of an array that become fields: no images, no clouds of points


def read_rosbag(file: Path) -> Recording:
    """Return the topics of a bag (a .bag file, a .mcap or .db3 in its folder, or that folder).

    Fields of messages by their way ("pose.pose.position.x", "covariance[0]"). Times are of the header's stamp where a message has
    one, else of the recording, seconds since the whole second before the first.
    Raises InputError for a file that is none, MissingPackageError where rosbags is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise missing_package("rosbags", "ros", "a ROS bag") from None
    place = file.parent if file.suffix in (".db3", ".mcap") and (file.parent / "metadata.yaml").exists() else file
    rows: dict[str, list[tuple[int, dict[str, float]]]] = defaultdict(list)
    try:
        with AnyReader([place], default_typestore=get_typestore(Stores.LATEST)) as reader:
            for connection, recorded, raw in reader.messages():
                message = reader.deserialize(raw, connection.msgtype)
                rows[connection.topic].append((_stamp(message) or recorded, dict(_numbers(message, ""))))
    except Exception as error:  # noqa: BLE001  # whatever it makes of a broken file
        raise InputError(f"{file}: is no bag that can be read: {type(error).__name__}: {error}") from None
    if not rows:
        raise InputError(f"{file}: has no message")
    epoch = min(stamp for messages in rows.values() for stamp, _ in messages) // 1_000_000_000
    topics = {name: _topic(name, messages, epoch) for name, messages in sorted(rows.items())}
    return Recording(file, "ROS bag", topics, float(epoch))


def _stamp(message: object) -> int:
    """Nanoseconds of the header's stamp, 0 where there is none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _numbers(value: object, way: str) -> Iterator[tuple[str, float]]:
    """Yield the numbers within a message and the ways that lead to them."""
    if isinstance(value, bool | int | float | np.number):
        yield way, float(value)
    elif isinstance(value, np.ndarray | list | tuple):
        for i, entry in enumerate(value[:_MAX_ARRAY] if len(value) <= _MAX_ARRAY else ()):
            yield from _numbers(entry, f"{way}[{i}]")
    elif hasattr(value, "__dataclass_fields__"):
        for name in value.__dataclass_fields__:  # pyright: ignore[reportAttributeAccessIssue]
            if not name.startswith("__"):
                yield from _numbers(getattr(value, name), f"{way}.{name}" if way else name)


def _topic(name: str, messages: list[tuple[int, dict[str, float]]], epoch: int) -> Topic:
    names = dict.fromkeys(key for _, row in messages for key in row)
    fields = {key: np.array([row.get(key, np.nan) for _, row in messages]) for key in names}
    # whole nanoseconds first: a double of Unix time has a fraction of a microsecond
    t = np.array([(stamp - epoch * 1_000_000_000) * 1e-9 for stamp, _ in messages])
    order = np.argsort(t, kind="stable")
    return Topic(name, t[order], {key: values[order] for key, values in fields.items()})

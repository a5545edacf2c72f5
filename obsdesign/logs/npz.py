"""Arrays of recorded runs in NumPy's NPZ: known layouts, and any others as topics."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.errors import InputError
from obsdesign.logs.recording import Recording, Topic
from obsdesign.logs.series import TRUTH, FileContents, Series

RANGING = ("odom", "gt", "ranges", "beacons")
TAGS = ("t", "pose", "ranges", "anchors", "tags_body")


def load_npz(file: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a file by name, numbers alone: nothing is unpickled. Raises InputError for what cannot be read."""
    try:
        with np.load(file, allow_pickle=False) as arrays:
            found = {name: arrays[name] for name in arrays.files}
    except (OSError, EOFError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{file}: is no NPZ of numbers: {error}") from None
    for name, values in found.items():
        if values.dtype.kind not in "biuf":
            raise InputError(f"{file}, array {name!r}: has entries of type {values.dtype}: must be numbers")
    return found


def read_npz(file: Path) -> Recording:
    """Return the arrays as topics: of ranging runs odom, gt and a topic for each beacon; of others those whose first column is a time."""
    arrays = load_npz(file)
    if set(RANGING) <= set(arrays):
        return Recording(file, "ranging run (odom, gt, ranges, beacons)", _ranging_topics(file, arrays), row_word="row")
    if set(TAGS) <= set(arrays):
        return Recording(file, "ranges of tags to anchors (t, pose, ranges)", _tag_topics(file, arrays), row_word="row")
    topics = {
        name: Topic(name, values[:, 0].astype(float), {f"[{i}]": values[:, i].astype(float) for i in range(1, values.shape[1])})
        for name, values in arrays.items()
        if values.ndim == 2 and values.shape[1] > 1 and len(values)
    }
    if not topics:
        raise InputError(f"{file}: has arrays {', '.join(arrays)}: none is a table whose first column is a time")
    return Recording(file, "arrays", topics, row_word="row")


def _columns(file: Path, name: str, values: np.ndarray, fields: tuple[str, ...], in_any_order: bool = False) -> Topic:
    if values.ndim != 2 or values.shape[1] != len(fields) + 1:
        raise InputError(f"{file}, array {name!r}: has shape {values.shape}: must have columns t, {', '.join(fields)}")
    t = values[:, 0].astype(float)
    if not np.isfinite(t).all():
        row = int(np.argmax(~np.isfinite(t)))
        raise InputError(f"{file}, array {name!r}, row {row}, column 0: is {t[row]}: must be finite")
    backwards = np.flatnonzero(np.diff(t) < 0)
    if len(backwards) and not in_any_order:
        row = int(backwards[0]) + 1
        raise InputError(f"{file}, array {name!r}, row {row}: t is {t[row]:.9g} after {t[row - 1]:.9g}: times must not go backwards")
    return Topic(name, t, {field: values[:, i + 1].astype(float) for i, field in enumerate(fields)})


def beacon_places(file: Path, values: np.ndarray) -> dict[float, tuple[float, float]]:
    """Return where the beacons stand (x, y) [m] by their names, numbers.

    Raises InputError for a place that is not finite, and for a name that stands there twice.
    """
    topic = _columns(file, "beacons", values, ("x", "y"), in_any_order=True)
    wrong = ~np.isfinite(np.column_stack(list(topic.fields.values()))).all(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(f"{file}, array 'beacons', row {row}: beacon {topic.t[row]:g} is at {values[row, 1:].tolist()}: must be finite")
    first = np.unique(topic.t, return_index=True)[1]
    if len(first) < len(topic.t):
        row = int(np.setdiff1d(np.arange(len(topic.t)), first)[0])
        raise InputError(f"{file}, array 'beacons', row {row}: beacon {topic.t[row]:g} stands there twice: must be once")
    return {float(name): (float(x), float(y)) for name, x, y in zip(topic.t, topic.fields["x"], topic.fields["y"], strict=True)}


def _ranging_topics(file: Path, arrays: dict[str, np.ndarray]) -> dict[str, Topic]:
    beacons = list(beacon_places(file, arrays["beacons"]))
    ranges = _columns(file, "ranges", arrays["ranges"], ("antenna", "beacon", "range"), in_any_order=True)
    unknown = np.flatnonzero(~np.isin(ranges.fields["beacon"], beacons))
    if len(unknown):
        row = int(unknown[0])
        accepted = ", ".join(f"{beacon:g}" for beacon in beacons)
        raise InputError(
            f"{file}, array 'ranges', row {row}, column 2: beacon {ranges.fields['beacon'][row]:g} is not among the beacons {accepted}"
        )
    topics = {
        "odom": _columns(file, "odom", arrays["odom"], ("distance", "turn")),
        "gt": _columns(file, "gt", arrays["gt"], ("x", "y", "heading")),
    }
    for beacon in beacons:
        chosen, name = ranges.fields["beacon"] == beacon, f"beacon_{beacon:g}"
        topics[name] = Topic(name, ranges.t[chosen], {"range": ranges.fields["range"][chosen]}, np.flatnonzero(chosen))
    return topics


def _tag_topics(file: Path, arrays: dict[str, np.ndarray]) -> dict[str, Topic]:
    """Poses, and for each anchor the ranges of all tags where all have one."""
    t, ranges = arrays["t"].astype(float), arrays["ranges"].astype(float)
    if t.ndim != 1 or ranges.ndim != 3 or len(ranges) != len(t) or arrays["pose"].shape != (len(t), 4):
        raise InputError(
            f"{file}: t {t.shape}, pose {arrays['pose'].shape} and ranges {ranges.shape} do not fit: (T,), (T, 4), (T, anchors, tags)"
        )
    topics = {"pose": _columns(file, "pose", np.column_stack([t, arrays["pose"]]), ("x", "y", "z", "yaw"))}
    for anchor in range(ranges.shape[1]):
        values = ranges[:, anchor]
        chosen = np.isfinite(values).all(axis=1)
        fields = {f"tag_{i}": values[chosen, i] for i in range(values.shape[1])}
        topics[f"anchor_{anchor}"] = Topic(f"anchor_{anchor}", t[chosen], fields, np.flatnonzero(chosen))
    return topics


def map_npz(recording: Recording, model: Model) -> FileContents:
    """Return the series of a known layout: odometry to speed and turn_rate, ranges to the sensors of the topics' names.

    Of ranging runs also to the sensor whose landmark is the beacon. Raises InputError for other layouts.
    """
    names = _RANGING_NAMES if "odom" in recording.topics else _TAG_NAMES if "pose" in recording.topics else None
    if names is None:
        raise InputError(f"{recording.file}: is of no known layout: say by `topics` what its arrays are ({', '.join(recording.topics)})")
    series = [
        _column_series(recording.topics[topic], (field,), name)
        for name, topic, field in names
        if name in model.input_names or (name.startswith(TRUTH) and name.removeprefix(TRUTH) in model.state_names)
    ]
    known = {topic for _, topic, _ in names}
    notes = []
    for topic in recording.topics.values():
        if topic.name in known:
            continue
        if topic.name in model.sensor_names:
            series.append(_column_series(topic, tuple(topic.fields), topic.name))
        else:
            notes.append(f"{topic.name}: no sensor of that name, {len(topic.t)} samples are left out")
    return FileContents(recording.file, tuple(series), recording.epoch, tuple(notes))


_RANGING_NAMES = (
    ("speed", "odom", "distance"),
    ("turn_rate", "odom", "turn"),
    ("truth.x", "gt", "x"),
    ("truth.y", "gt", "y"),
    ("truth.heading", "gt", "heading"),
)
_TAG_NAMES = (("truth.x", "pose", "x"), ("truth.y", "pose", "y"), ("truth.heading", "pose", "yaw"))


def _column_series(topic: Topic, fields: tuple[str, ...], name: str) -> Series:
    """A series of some fields; odometry holds what came together since the row before."""
    values = np.column_stack([topic.fields[field] for field in fields])
    is_angle = name == TRUTH + "heading"
    values = np.unwrap(values, axis=0) if is_angle else values
    column = f"{topic.name}.{'/'.join(fields)}"
    rows = np.arange(len(topic.t)) if topic.rows is None else topic.rows
    return Series(name, topic.t, values, column, rows, "row", is_increment=topic.name == "odom")

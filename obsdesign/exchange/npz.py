"""NumPy's archive of arrays, exact, without pickles."""

from __future__ import annotations

import io
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from obsdesign.errors import InputError
from obsdesign.exchange.abstract import MAX_BYTES, AbstractFormat, Precision, read_bytes
from obsdesign.exchange.geodesy import geodetic
from obsdesign.exchange.track import Track, about_text, read_about

_NUMBERS = ("t", "position", "heading")


@dataclass(frozen=True)
class NumpyArchive(AbstractFormat):
    """t (N,) [s], position (N, 3) [m, east north up], heading (N,) [rad], geodetic (N, 3) [degrees, degrees, m], about: JSON."""

    @property
    def suffix(self) -> str:
        """.npz."""
        return ".npz"

    @property
    def precision(self) -> Precision:
        """Exact."""
        return Precision(0.0, 0.0, 0.0)

    @property
    def is_mission(self) -> bool:
        """Points in time."""
        return False

    def write(self, track: Track, target: Path) -> None:
        """Write the arrays, without pickles."""
        arrays = {"t": track.t, "position": track.position, "about": np.array(about_text(track)), "name": np.array(track.name)}
        if track.heading is not None:
            arrays["heading"] = track.heading
        if track.origin is not None:
            arrays["geodetic"] = geodetic(track, "npz")
        archive = io.BytesIO()  # NumPy 2.0 leaves an archive open that it cannot write to the end
        np.savez(archive, **arrays)  # pyright: ignore[reportArgumentType]  # no array is called allow_pickle
        target.write_bytes(archive.getvalue())

    def parse(self, file: Path) -> Track:
        """Return the track; archives that would unpack to more than MAX_BYTES, or hold pickles, are refused."""
        read_bytes(file)
        try:
            with zipfile.ZipFile(file) as archive:
                members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
                if sum(info.file_size for info in members.values()) > MAX_BYTES or len(members) > 100:
                    raise InputError(f"{file}: would unpack to more than {MAX_BYTES} bytes")
                arrays = {name: _array(archive, members[name]) for name in (*_NUMBERS, "about", "name") if name in members}
        except (zipfile.BadZipFile, OSError, NotImplementedError, RuntimeError, zlib.error) as error:
            raise InputError(f"{file}: is no archive of arrays: {error}") from None
        about = read_about(_text(arrays.get("about")))
        numbers = [arrays[name] for name in _NUMBERS if name in arrays]
        if any(values.dtype.kind not in "fiu" for values in numbers):
            raise InputError(f"{file}: t, position and heading must be numbers")
        name = _text(arrays.get("name")) or file.stem
        return Track(arrays["t"], arrays["position"], arrays.get("heading"), about.origin, about.epoch, about.sensors, name)


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """Return an array of the archive; its header may not promise more than the archive holds."""
    with archive.open(info) as member:
        version = np.lib.format.read_magic(member)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read_header(member)
    if dtype.hasobject or np.prod([float(size) for size in shape]) * dtype.itemsize > info.file_size:
        raise InputError(f"{info.filename} is a pickle, or shorter than its header says")
    with archive.open(info) as member:
        return np.lib.format.read_array(member, allow_pickle=False)


def _text(array: np.ndarray | None) -> str | None:
    return str(array) if array is not None and array.dtype.kind == "U" and array.ndim == 0 else None

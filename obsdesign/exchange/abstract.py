"""What a file format of paths is, and reading and writing files as a whole."""

from __future__ import annotations

import gc
import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from obsdesign.checks import all_finite, as_array
from obsdesign.errors import InputError
from obsdesign.exchange.track import Track

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

    import numpy as np

_BROKEN = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError, MemoryError, EOFError)
_PART = 2**12  # bytes of an XML file
MAX_BYTES = 256 * 2**20  # of a file that is read, and of what is packed in one


@dataclass(frozen=True)
class Precision:
    """By how much what was written and read again may be off: position [m], time [s] and heading [rad]; None: the format has none."""

    position: float
    time: float | None
    heading: float | None


class AbstractFormat(ABC):
    """A file format of paths. Leaves are final frozen dataclasses, one file each; `formats.py` names them all."""

    @property
    @abstractmethod
    def suffix(self) -> str:
        """What names of such files end with."""

    @property
    @abstractmethod
    def precision(self) -> Precision:
        """How exactly a file tells a path."""

    @property
    @abstractmethod
    def is_mission(self) -> bool:
        """Whether it holds way points to be flown instead of points in time."""

    @abstractmethod
    def write(self, track: Track, target: Path) -> None:
        """Write a track to a file, or folder, that is not there yet. Raises InputError for a track that the format cannot hold."""

    @abstractmethod
    def parse(self, file: Path) -> Track:
        """Return the track that a file holds; a KeyError, IndexError, TypeError, ValueError, ... means that it holds none."""

    def read(self, file: Path) -> Track:
        """Read a track; raises InputError, naming the file, for what is none. Runs nothing that a file holds, and writes nothing."""
        try:
            with collection_deferred():
                return self.parse(file)
        except _BROKEN as error:
            if isinstance(error, InputError):
                raise InputError(str(error) if str(error).startswith(str(file)) else f"{file}: {error}") from None
            raise InputError(f"{file}: holds no path: {type(error).__name__}: {error}"[:500]) from None


@contextmanager
def collection_deferred() -> Iterator[None]:
    """Look for cycles of references later: what is made of a file, or for one, has none, and would be looked at again and again."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def read_bytes(file: Path) -> bytes:
    """Return a file's bytes; raise InputError for one that cannot be read or is too large."""
    try:
        size = file.stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"{file}: has {size} bytes: must be at most {MAX_BYTES}")
        return file.read_bytes()
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None


def read_text(file: Path) -> str:
    """Return a file's text; raise InputError for one that is no UTF-8."""
    try:
        return read_bytes(file).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: is not UTF-8 text (byte {error.start})") from None


def read_json(file: Path) -> dict[str, Any]:
    """Return the object of a JSON file; raise InputError for one that is none, or has NaN or infinity in it."""

    def refuse(text: str) -> float:
        raise InputError(f"{file}: holds {text}: must be a finite number")

    try:
        document = json.loads(read_text(file), parse_constant=refuse)
    except (json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"{file}: is no JSON: {error}") from None
    if not isinstance(document, dict):
        raise InputError(f"{file}: holds a {type(document).__name__}: must be an object")
    return document


def numbers(what: str, values: Any) -> np.ndarray:  # noqa: ANN401  # whatever a file holds
    """Return a list of numbers, or of rows of equal length, as floats; raise InputError for anything else, null among it."""
    array = as_array(what, values)
    if not all_finite(array):
        raise InputError(f"{what} holds numbers that are not finite")
    return array


def number_rows(what: str, texts: Sequence[str]) -> np.ndarray:
    """Return the numbers (N, q) of texts of q numbers each, white space between them; raise InputError for texts of different length."""
    import numpy as np

    counts = [len(text.split()) for text in texts]
    if len(set(counts)) > 1:
        odd = next(i for i, count in enumerate(counts) if count != counts[0])
        raise InputError(f"{what} {odd + 1} has {counts[odd]} numbers, {what} 1 has {counts[0]}")
    return np.array(list(map(float, " ".join(texts).split()))).reshape(len(texts), -1 if texts and counts[0] else 0)


def read_xml(file: Path) -> Element:
    """Return the root of an XML file without document type and entities; raise InputError for any other."""
    from xml.etree.ElementTree import ParseError, fromstring

    from defusedxml import DefusedXmlException

    data = read_bytes(file)
    try:
        _require_plain(data)
        return fromstring(data)
    except DefusedXmlException:
        raise InputError(f"{file}: declares a document type or entities: must be plain XML") from None
    except (ParseError, ValueError, LookupError) as error:
        raise InputError(f"{file}: is no XML: {error}") from None


def _require_plain(data: bytes) -> None:
    """Raise DefusedXmlException for a document type or entities, which XML allows before its first element only; read no further."""
    from xml.etree.ElementTree import TreeBuilder

    from defusedxml.ElementTree import DefusedXMLParser

    begun: list[str] = []

    class Prolog(TreeBuilder):
        """Notes that the first element has begun."""

        def start(self, tag: str, attrs: dict[str, str], /) -> Element:
            """Note an element."""
            begun.append(tag)
            return super().start(tag, attrs)

    parser = DefusedXMLParser(target=Prolog(), forbid_dtd=True)
    for first in range(0, len(data), _PART):
        parser.feed(data[first : first + _PART])
        if begun:
            return

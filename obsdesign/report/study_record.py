"""A study as JSON, and back: every number to the last bit, so that the page can be built again."""

from __future__ import annotations

import base64
import importlib
import math
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np

import obsdesign
from obsdesign.design.record import Design
from obsdesign.errors import InputError
from obsdesign.joint.result import Joint
from obsdesign.planning.closed_loop import Flight
from obsdesign.report.document import Result
from obsdesign.scenario.loading import scenario_from_text
from obsdesign.study.record import Study

_ROOM = "obsdesign."  # records of these modules are made again, and nothing else
_PLAIN = (str, int, bool, type(None))
_CLOCK = "seconds"  # field of these: how long something took; varies from run to run, and no page shows it
_CLOCKS = {Study: MappingProxyType({}), Flight: (), Design: math.nan, Joint: math.nan}
_IRREGULAR = ("nan", "inf", "-inf")
_ARRAYS = re.compile(r"[<|][biuf][1248]")


def encode_study(study: Study) -> list[Any]:
    """Return a study as a list of JSON values, itself last; what stands in several places is written once.

    The scenario is left out, as its text stands in result.json, and so are times of the clock.
    """
    return _Encoder(study.scenario).listing(study)


def study_of(result: Result, file: str | Path = "result.json") -> Study:
    """Return the study that a result.json is of.

    Arguments:
        result: the document.
        file: what messages call it.
    Raises InputError where the document holds no record, or one that this version of obsdesign cannot read.
    """
    if not result.record:
        raise InputError(f"{file}: holds no record of the study (of a scenario that was made in Python, or left out): run it again")
    scenario = scenario_from_text(result.scenario.source, result.scenario.file)
    if not result.expected:
        scenario = scenario.model_copy(update={"expected": ()})
    try:
        study = _Decoder(scenario).decode(result.record)
    except (KeyError, TypeError, ValueError, IndexError, ImportError, AttributeError, RecursionError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise InputError(
            f"{file}: its record is not one that obsdesign {obsdesign.__version__} can read ({reason}): run it again"
        ) from None
    if not isinstance(study, Study):
        raise InputError(f"{file}: its record is of {type(study).__name__}: must be of a Study")
    return replace(study, seconds=result.timings)


class _Encoder:
    """Writes values, each record and array once."""

    def __init__(self, scenario: object) -> None:
        self._scenario = scenario
        self._written: list[Any] = []
        self._places: dict[int, int] = {}
        self._alive: list[object] = []  # what is written stays, so that no address is used twice

    def listing(self, record: object) -> list[Any]:
        """Return all that was written, the record last."""
        last = self._value(record)
        return [*self._written, last]

    def _value(self, value: Any) -> Any:  # noqa: ANN401, PLR0911  # one for each kind
        if isinstance(value, Enum):
            return {"enum": _name(type(value)), "name": value.name}
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, _PLAIN):
            return value
        if isinstance(value, float):
            return value if np.isfinite(value) else {"float": str(value)}
        if value is self._scenario:
            return {"scenario": 0}
        if isinstance(value, tuple | list | range):
            return [self._value(item) for item in value]
        if isinstance(value, Mapping):
            return {"map": [[self._value(key), self._value(item)] for key, item in value.items()]}
        return self._once(value)

    def _once(self, value: Any) -> Any:  # noqa: ANN401
        if id(value) not in self._places:
            written = self._array(value) if isinstance(value, np.ndarray) else self._record(value)
            self._places[id(value)] = len(self._written)
            self._written.append(written)
            self._alive.append(value)
        return {"at": self._places[id(value)]}

    def _array(self, array: np.ndarray) -> Any:  # noqa: ANN401
        if array.dtype.kind not in "biuf":
            raise TypeError(f"no array of {array.dtype} can be written")
        little = array.astype(array.dtype.newbyteorder("<"), order="C")
        return {"array": base64.b64encode(little.tobytes()).decode(), "type": little.dtype.str, "shape": list(array.shape)}

    def _record(self, record: Any) -> Any:  # noqa: ANN401
        if not is_dataclass(record):
            raise TypeError(f"no {type(record).__name__} can be written")
        names = [field.name for field in fields(record)]
        clocks = (_CLOCK,) if type(record) in _CLOCKS else ()
        return {"record": _name(type(record)), "fields": {name: self._value(getattr(record, name)) for name in names if name not in clocks}}


def _name(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


class _Decoder:
    """Makes values again, each record and array once. Runs no code but that of this file: fields are set, no constructor is called."""

    def __init__(self, scenario: object) -> None:
        self._scenario = scenario
        self._made: list[Any] = []

    def decode(self, listing: list[Any]) -> Any:  # noqa: ANN401
        """Return the last of the values."""
        for written in listing[:-1]:
            self._made.append(_array_of(written) if "array" in written else self._record(written))
        return self._value(listing[-1])

    def _value(self, written: Any) -> Any:  # noqa: ANN401, PLR0911  # one for each kind
        if isinstance(written, list):
            return tuple(map(self._value, written))
        if not isinstance(written, dict):
            return written
        ((kind, content), *_) = written.items()
        if kind == "at":
            return self._made[content]
        if kind == "map":
            return {self._value(key): self._value(item) for key, item in content}
        if kind == "enum":
            return _class_of(content, Enum)[written["name"]]
        if kind == "float" and content in _IRREGULAR:
            return float(content)
        if kind == "scenario":
            return self._scenario
        raise ValueError(f"no value is written as {kind!r}")

    def _record(self, written: Any) -> Any:  # noqa: ANN401
        kind = _class_of(written["record"], object)
        if not is_dataclass(kind):
            raise TypeError(f"{written['record']} is no record")
        clocks = {_CLOCK: _CLOCKS[kind]} if kind in _CLOCKS else {}
        values = {name: self._value(value) for name, value in written["fields"].items()} | clocks
        names = [field.name for field in fields(kind)]
        if set(names) != set(values):
            raise ValueError(f"{written['record']} has the fields {', '.join(values)}: must be {', '.join(names)}")
        record: Any = object.__new__(cast(type, kind))
        for name, value in values.items():
            object.__setattr__(record, name, value)
        return record


def _array_of(written: Any) -> np.ndarray:  # noqa: ANN401
    if not _ARRAYS.fullmatch(written["type"]):
        raise ValueError(f"no array of {written['type']!r} is read")
    flat = np.frombuffer(base64.b64decode(written["array"], validate=True), dtype=written["type"])
    return flat.reshape(written["shape"]).astype(flat.dtype.newbyteorder("="))


def _class_of(name: str, base: type) -> Any:  # noqa: ANN401
    """Return a class of obsdesign by its module and name."""
    module, _, qualname = name.partition(":")
    if not module.startswith(_ROOM) or not qualname.isidentifier():
        raise ValueError(f"{name!r} is no record of obsdesign")
    kind = getattr(importlib.import_module(module), qualname)
    if not isinstance(kind, type) or not issubclass(kind, base) or kind.__module__ != module:
        raise TypeError(f"{name!r} is no record of obsdesign")
    return kind

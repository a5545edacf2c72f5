"""What is wrong with a scenario, in words: the key's path, its value, what is accepted."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from obsdesign.scenario.degrees import SUFFIX
from obsdesign.scenario.kind_tables import COST

_TABLE, _WORD, _ARRAY = "dict[", "literal[", "tuple["  # how pydantic names types that a value may be
Location = tuple[str | int, ...]
# (location of a table) -> the keys it accepts, or nothing where any are
AcceptedKeys = Callable[[Location], Sequence[str]]


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: where (a key's path) and why; the names that are accepted, where they can be listed, and the nearest."""

    location: Location
    message: str
    accepted: tuple[str, ...] = ()
    nearest: str | None = None

    def __str__(self) -> str:
        return f"{location_text(self.location)}: {self.message}"


def location_text(location: Location) -> str:
    """Return a location as it would be written: sensors[0].sigma."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return text.removeprefix(".") or "scenario"


def describe_error(error: Mapping[str, Any], data: Any, accepted: AcceptedKeys) -> Problem:  # noqa: ANN401
    """Return a pydantic error as a Problem of the TOML data it came from."""
    location, kind = in_file(error["loc"], data), error["type"]
    value = value_at(data, location)
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        return unknown_key(location, str(location[-1]), [key for key in accepted(error["loc"][:-1]) if key])
    if kind.startswith("missing"):
        return Problem(location, "missing key")
    if kind == "union_tag_not_found":
        return Problem((*location, "kind"), "missing key")
    if kind == "union_tag_invalid":
        choices = [tag for tag in (part.strip("' ") for part in error["ctx"]["expected_tags"].split(",")) if tag]
        return unknown_name((*location, "kind"), error["ctx"]["tag"], choices)
    if kind == "value_error":
        reason, written = str(error["ctx"]["error"]), value.items() if isinstance(value, Mapping) else ()
        degrees = [f"{key} = {item}" for key, item in written if key.endswith(SUFFIX) and key.removesuffix(SUFFIX) in reason]
        given = f" (given as {', '.join(degrees)})" if degrees else ""
        return Problem(location, reason + given)
    message = error["msg"].replace("Input should be", "must be")
    return Problem(location, f"is {value!r}: {message[:1].lower()}{message[1:]}")


def of_another_type(error: Mapping[str, Any], data: Any) -> bool:  # noqa: ANN401
    """Whether an error of a value that may be a number or a table, or a word or an array, is about the one that was not given."""
    location = error["loc"]
    for index, part in enumerate(location):
        if _is_type(part):
            value, name = value_at(data, in_file(location[:index], data)), str(part)
            if name.startswith((_WORD, _ARRAY)):
                return isinstance(value, list) != name.startswith(_ARRAY)
            return isinstance(value, Mapping) != name.startswith(_TABLE)
    return False


def of_a_part(error: Mapping[str, Any], data: Any) -> bool:  # noqa: ANN401
    """Whether an array is said to be too short only because what is wrong with its entries has been told already."""
    value = value_at(data, in_file(error["loc"], data))
    return error["type"] == "too_short" and isinstance(value, list) and len(value) >= error["ctx"]["min_length"]


def unknown_key(location: Location, key: str, accepted: Sequence[str]) -> Problem:
    """Return what is wrong with a key that nobody knows."""
    hint, nearest = nearest_word(key.removesuffix(SUFFIX), accepted)
    return Problem(location, f"unknown key{hint} (accepted: {', '.join(accepted) or 'none'})", tuple(accepted), nearest)


def unknown_name(location: Location, name: str, accepted: Sequence[str]) -> Problem:
    """Return what is wrong with a value that must be one of several names."""
    hint, nearest = nearest_word(name, accepted)
    return Problem(location, f"is {name!r}: must be one of {', '.join(accepted)}{hint}", tuple(accepted), nearest)


def list_problems(location: Location, names: Sequence[str], accepted: Sequence[str]) -> Iterator[Problem]:
    """Yield what is wrong with a list of names, each of which must be one of several and stand there once."""
    yield from (unknown_name(location, name, accepted) for name in names if name not in accepted)
    yield from (Problem(location, f"names {name!r} twice") for i, name in enumerate(names) if name in names[:i])


def nearest_word(word: str, accepted: Sequence[str]) -> tuple[str, str | None]:
    """Return a hint at the accepted word that is nearest, and that word, where one is near."""
    near = difflib.get_close_matches(word, accepted, n=1)
    return (f"; did you mean {near[0]!r}?", near[0]) if near else ("", None)


def in_file(location: Location, data: Any) -> Location:  # noqa: ANN401
    """Return the location as it stands in the file: without the tags of unions and tables made here, with _deg where that was written."""
    file_location: list[str | int] = []
    for index, part in enumerate(location):
        if isinstance(data, (str, int, float)) or (isinstance(data, list) and isinstance(part, str)):
            break  # a value that stands for a table of one
        if _is_type(part) and not (isinstance(data, Mapping) and part in data):
            continue
        if isinstance(data, Mapping) and (part == data.get("kind") or (part == COST and COST not in data)):
            continue
        in_degrees = isinstance(data, Mapping) and part not in data and f"{part}{SUFFIX}" in data
        file_location.append(f"{part}{SUFFIX}" if in_degrees else part)
        data = value_at(data, (file_location[-1],)) if index < len(location) - 1 else data
    return tuple(file_location)


def _is_type(part: str | int) -> bool:
    """Whether a part of a location is one of the types that a value may have: no key, but pydantic's name of it."""
    return isinstance(part, str) and (part == "float" or part.startswith((_TABLE, _WORD, _ARRAY)))


def value_at(data: Any, location: Location) -> Any:  # noqa: ANN401
    """Return the value of TOML data at a location; None where there is none."""
    for part in location:
        if isinstance(data, Mapping):
            data = data.get(str(part))
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
        else:
            return None
    return data

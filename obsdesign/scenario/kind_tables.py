"""Tables that name a class under `kind`: how they are read, and how a JSON Schema describes them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Annotated, Any, Union

from pydantic import BeforeValidator, ConfigDict, Discriminator, GetCoreSchemaHandler, GetJsonSchemaHandler, Tag, TypeAdapter
from pydantic_core import CoreSchema, PydanticKnownError, core_schema

import obsdesign.constraints
import obsdesign.costs
import obsdesign.paths
import obsdesign.rules
import obsdesign.sensors
import obsdesign.vehicles
from obsdesign.families import kinds, leaf
from obsdesign.scenario.log_schema import required_of

COST = "cost"  # where the keys of a cost are kept beside what it counts for; no key of the file
SUFFIX = "_deg"  # of a key whose value is in degrees
_Json = dict[str, Any]

_RULES = "obsdesign.rules"  # the one family whose leaves keep tables as they are, and have no angles
_PACKAGES = (obsdesign.vehicles, obsdesign.sensors, obsdesign.paths, obsdesign.constraints, obsdesign.costs, obsdesign.rules)
_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


def family_of(package: ModuleType) -> Any:  # noqa: ANN401  # a type made at run time
    """Return the type of a table that names one of a family's leaves under `kind`; only the leaf that is named is loaded."""
    return Annotated[Any, _Family(package)]


def leaf_of(kind: str | int) -> type | None:
    """Return the class that tables name under `kind`, None where there is none of that kind."""
    return next((leaf(package, str(kind)) for package in _PACKAGES if kind in kinds(package)), None)


@dataclass(frozen=True)
class _Family:
    """Reads a table into the leaf that it names, and describes all of them in a JSON Schema."""

    package: ModuleType

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self._read)

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> _Json:
        return handler(_union(self.package, kinds(self.package)).core_schema)

    def _read(self, table: object) -> object:
        kind, accepted = _kind_of(table), kinds(self.package)
        if kind is None:
            raise PydanticKnownError("union_tag_not_found", {"discriminator": "kind"})
        if kind not in accepted:
            raise PydanticKnownError("union_tag_invalid", {"discriminator": "kind", "tag": str(kind), "expected_tags": ", ".join(accepted)})
        # as JSON, which it came from: what is strict takes arrays for tuples, and tables for records, from there alone
        return _union(self.package, (kind,)).validate_json(json.dumps(table))


@cache
def _union(package: ModuleType, of: tuple[str, ...]) -> TypeAdapter[Any]:
    """Return the union of a family's leaves of some kinds, told apart by the key `kind`."""
    is_rules = package.__name__ == _RULES

    def without_kind(table: dict[str, Any]) -> dict[str, Any]:
        """Return the table's other keys, lists as tuples."""
        return {key: _tuples(value, tables=is_rules) for key, value in table.items() if key != "kind"}

    members = [
        Annotated[leaf(package, kind), BeforeValidator(without_kind), _KindSchema(kind, angles=not is_rules), Tag(kind)] for kind in of
    ]
    # a last, empty tag: a union of one member is no union
    union: Any = Annotated[Union[(*members, Annotated[None, Tag("")])], Discriminator(_kind_of)]
    return TypeAdapter(union, config=_STRICT)


def _kind_of(table: object) -> Any:  # noqa: ANN401
    """Return the kind that a table names."""
    return table.get("kind") if isinstance(table, dict) else None


def flat_table(amount_key: str) -> tuple[Any, ...]:
    """Return what reads a table of a cost's keys and `amount_key` into one of `cost` and `amount_key`."""

    def split(table: Any) -> Any:  # noqa: ANN401
        """Return the cost's keys in a table of their own, beside the amount."""
        if not isinstance(table, dict):
            return table
        return {key: table[key] for key in (amount_key,) if key in table} | {
            COST: {key: item for key, item in table.items() if key != amount_key}
        }

    return BeforeValidator(split), _FlatSchema(amount_key)


def in_degrees_too(*keys: str) -> tuple[Any, ...]:
    """Return what says in a table's JSON Schema that numbers may be given in degrees as well, under their keys with the suffix _deg."""
    return (_DegreesSchema(keys),)


def _tuples(value: Any, tables: bool = False) -> Any:  # noqa: ANN401
    """Lists become tuples, tables pairs unless they stay tables, as leaves keep them."""
    items = list(value.items()) if isinstance(value, dict) and not tables else value
    return tuple(_tuples(item) for item in items) if isinstance(items, list | tuple) else value


@dataclass(frozen=True)
class _KindSchema:
    """Makes a leaf's JSON Schema that of its table in a file: with the key `kind`, numbers also in degrees, pairs as a table."""

    kind: str
    angles: bool = True

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> _Json:
        schema = handler(core)
        table = handler.resolve_ref_schema(schema)
        if "kind" not in table["properties"]:
            properties = {key: _as_table(item) for key, item in table["properties"].items()}
            table["properties"] = {"kind": {"const": self.kind}} | properties
            table["required"] = ["kind", *required_of(self.kind, table.get("required", []))]
            _add_degrees(table, [key for key, item in properties.items() if self.angles and _is_number(item)])
        return schema


@dataclass(frozen=True)
class _DegreesSchema:
    """Makes a table's JSON Schema accept some numbers in degrees, too."""

    keys: tuple[str, ...]

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> _Json:
        schema = handler(core)
        _add_degrees(handler.resolve_ref_schema(schema), self.keys)
        return schema


def _add_degrees(table: _Json, keys: Iterable[str]) -> None:
    """Let a table have each of the keys with the suffix _deg in its place."""
    required = table.get("required", [])
    needed = [key for key in required if key not in keys]
    either = [{"anyOf": [{"required": [key]}, {"required": [f"{key}{SUFFIX}"]}]} for key in required if key in keys]
    table["properties"] |= {f"{key}{SUFFIX}": table["properties"][key] for key in keys}
    table |= {"required": needed} | ({"allOf": either} if either else {})


def _is_number(schema: _Json) -> bool:
    return any(option.get("type") == "number" for option in (schema, *schema.get("anyOf", ())))


def _as_table(schema: _Json) -> _Json:
    pair = schema.get("items", {}).get("prefixItems", [])
    named = [item.get("type") for item in pair] == ["string", "number"]
    return {"type": "object", "additionalProperties": pair[1]} if named else schema


@dataclass(frozen=True)
class _FlatSchema:
    """Describes a cost and what it counts for as the one table that they are in a file."""

    amount_key: str

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> _Json:
        table = handler.resolve_ref_schema(handler(core))
        amount_schema = table["properties"][self.amount_key]
        members = next(value for key, value in table["properties"][COST].items() if key in ("anyOf", "oneOf"))
        leaves = [handler.resolve_ref_schema(member) for member in members if "$ref" in member]
        return {"anyOf": [_add_property(member_schema, self.amount_key, amount_schema) for member_schema in leaves]}


def _add_property(leaf_schema: _Json, key: str, value: _Json) -> _Json:
    return leaf_schema | {"properties": leaf_schema["properties"] | {key: value}, "required": [*leaf_schema["required"], key]}

"""Refusing arguments of a wrong type by name, from the annotations that a public function or record has anyway."""

from __future__ import annotations

import ast
import importlib
import inspect
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from functools import cache, wraps
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from obsdesign.checks import as_array
from obsdesign.errors import InputError, ObsdesignError

Public = TypeVar("Public", bound=Callable[..., Any])
Part = tuple[str, Any, "Kind"]  # an entry of a container: where it stands, what it is, what is accepted there


@dataclass(frozen=True)
class Kind:
    """What an annotation accepts: a test of the value itself, what passes it in words, and the entries to be tested as well."""

    passes: Callable[[Any], bool]
    accepted: str
    parts: Callable[[Any], Iterator[Part]] | None = None

    def accepts(self, value: Any) -> bool:  # noqa: ANN401  # whatever a caller gave
        """Return whether the value is accepted, with all of its entries."""
        if self.parts is None:
            return self.passes(value)
        return self.passes(value) and all(kind.accepts(part) for _, part, kind in self.parts(value))

    @property
    def test(self) -> Callable[[Any], bool]:
        """The test alone where there are no entries, which is all that is asked of most values."""
        return self.passes if self.parts is None else self.accepts

    def refuse(self, what: str, value: Any) -> None:  # noqa: ANN401  # whatever a caller gave
        """Raise InputError for the first entry that is not accepted, or for the value itself."""
        for where, part, kind in self.parts(value) if self.parts is not None and self.passes(value) else ():
            if not kind.accepts(part):
                kind.refuse(f"{what}{where}", part)
        raise InputError(f"{what} is {_display(value)}: must be {self.accepted}")


def validate_arguments(public: Public) -> Public:
    """Return the function, or the class with its constructor, so that it refuses arguments of a type other than annotated.

    The InputError names the argument, shows the value and says what is accepted: before any work, but after the checks that a
    constructor makes itself, which know more. Numbers of NumPy are numbers, `nan` is none; a list or an array will do for a
    tuple; what is annotated Any or by a type variable is taken as it is.
    """
    if inspect.isclass(public):
        public.__init__ = _validating_constructor(public.__init__, public)
        return public  # pyright: ignore[reportReturnType]
    require = _requirement(public, public)

    @wraps(public)
    def wrapper(*arguments: Any, **named: Any) -> Any:  # noqa: ANN401  # those of the function
        """Validate the arguments, then call."""
        require("", arguments, named)
        return public(*arguments, **named)

    return wrapper  # pyright: ignore[reportReturnType]


def _validating_constructor(constructor: Callable[..., None], record: type) -> Callable[..., None]:
    require = _requirement(constructor, record)

    @wraps(constructor)
    def wrapper(self: object, *arguments: Any, **named: Any) -> None:  # noqa: ANN401  # those of the constructor
        """Validate the arguments, then call."""
        try:
            constructor(self, *arguments, **named)
        except ObsdesignError:
            raise
        except Exception:  # whatever a wrong type makes of it; raised again where all arguments are of their kind
            require(f"{record.__name__}: ", (self, *arguments), named)
            raise
        require(f"{record.__name__}: ", (self, *arguments), named)

    return wrapper


def _requirement(function: Callable[..., Any], public: Callable[..., Any]) -> Callable[[str, tuple[Any, ...], dict[str, Any]], None]:
    """Return what raises InputError for the first of the arguments that is not accepted, its name after a prefix."""
    names = tuple(inspect.signature(function).parameters)

    @cache
    def kinds() -> tuple[dict[str, Kind], tuple[Callable[[Any], bool], ...]]:  # when first called: annotations may name what comes later
        """Return the kinds of the arguments, by name and in order."""
        kinds_by_name = {name: kind_of(hint) for name, hint in _hints(function, public)}
        return kinds_by_name, tuple(kinds_by_name.get(name, _ANYTHING).test for name in names)

    def require(prefix: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> None:
        """Raise InputError for the first argument that is not of its kind."""
        kinds_by_name, tests = kinds()
        for i, (test, value) in enumerate(zip(tests, arguments, strict=False)):
            if not test(value):
                kinds_by_name[names[i]].refuse(prefix + names[i], value)
        for name, value in named.items():
            if name in kinds_by_name and not kinds_by_name[name].accepts(value):
                kinds_by_name[name].refuse(prefix + name, value)

    return require


def _display(value: Any) -> str:  # noqa: ANN401  # whatever a caller gave
    try:
        text = repr(value)
    except Exception:  # noqa: BLE001  # a value that cannot even be shown, or a number too long for it
        text = f"of type {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}..."


# ---------------------------------------------------------------- annotations


def _hints(function: Callable[..., Any], public: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Yield each annotated parameter with its annotation, resolved where it was written: fields in the class that defines them."""
    bases = public.__mro__ if inspect.isclass(public) else ()
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.annotation is parameter.empty:
            continue
        owner = next((base for base in bases if name in vars(base).get("__annotations__", {})), public)
        module = sys.modules[owner.__module__]
        named = SimpleNamespace(__annotations__={name: parameter.annotation})
        try:
            hints = get_type_hints(named, vars(module))
        except NameError:
            hints = get_type_hints(named, {**_type_checking_names(module.__name__), **vars(module)})
        yield name, hints[name]


@cache
def _type_checking_names(module: str) -> dict[str, Any]:
    """Return what a module imports for annotations alone, under `if TYPE_CHECKING`."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    blocks = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    names: dict[str, Any] = {}
    for node in (statement for block in blocks for statement in block.body):
        if isinstance(node, ast.ImportFrom) and node.module:
            source = importlib.import_module(node.module)
            names |= {alias.asname or alias.name: getattr(source, alias.name) for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.asname or alias.name: importlib.import_module(alias.name) for alias in node.names}
    return names


def kind_of(hint: Any) -> Kind:  # noqa: ANN401  # an annotation
    """Return what a resolved annotation accepts."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return _one_of(_members(inner))
    if origin is Literal:
        return Kind(lambda value: isinstance(value, str) and value in inner, f"one of {', '.join(map(repr, inner))}")
    if origin is tuple and inner[-1] is not Ellipsis:
        return _row_of_length([kind_of(argument) for argument in inner])
    if inspect.isclass(origin) and issubclass(origin, Mapping):
        return _table(*map(kind_of, inner))
    if inspect.isclass(origin) and issubclass(origin, Sequence):
        return _row(kind_of(inner[0]))
    return (
        _of_class(hint) if inspect.isclass(hint) and hint is not Any else Kind(callable, "a function") if origin is Callable else _ANYTHING
    )


def _of_class(hint: type) -> Kind:
    if hint in _PLAIN:
        return _PLAIN[hint]
    if hint.__module__ == "numpy" and hint.__name__ == "ndarray":
        return _ARRAY
    if hint.__module__ == "casadi.casadi" and hint.__name__ == "SX":
        return Kind(lambda value: isinstance(value, hint) or type(value).__name__ == "DM" or _is_array(value), "a CasADi SX expression")
    return _instance_of(hint)


def _members(inner: Sequence[Any]) -> list[Kind]:
    """Return what the members of a union accept; ArrayLike is one of many members, which count as one."""
    if any("_SupportsArray" in str(member) for member in inner):
        own_members = [member for member in inner if member is NoneType or getattr(member, "__module__", "").startswith("obsdesign")]
        return [_ARRAY, *map(kind_of, own_members)]
    return [kind_of(member) for member in inner]


def _is_whole(value: Any) -> bool:  # noqa: ANN401  # whatever a caller gave
    return isinstance(value, Integral) and not isinstance(value, bool) and abs(int(value)) <= sys.maxsize


def _is_number(value: Any) -> bool:  # noqa: ANN401  # whatever a caller gave
    if type(value) is float:
        return not math.isnan(value)
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return float(value) == float(value)
    except OverflowError:
        return False


def _is_array(value: Any) -> bool:  # noqa: ANN401  # whatever a caller gave
    kind = getattr(getattr(value, "dtype", None), "kind", "")
    if kind:
        return kind in "biuf"
    try:
        as_array("array", value)
    except InputError:
        return False
    return True


def _is_truth(value: Any) -> bool:  # noqa: ANN401  # whatever a caller gave
    return isinstance(value, bool) or type(value).__name__ == "bool"  # numpy.bool


_ANYTHING = Kind(lambda _: True, "anything")
_ARRAY = Kind(_is_array, "an array of real numbers")
_PLAIN: Mapping[Any, Kind] = {
    NoneType: Kind(lambda value: value is None, "None"),
    bool: Kind(_is_truth, "True or False"),
    int: Kind(_is_whole, "a whole number"),
    float: Kind(_is_number, "a number"),
    str: Kind(lambda value: isinstance(value, str), "a text"),
    Path: Kind(lambda value: isinstance(value, Path), "a path"),
}


def _is_row(value: Any) -> bool:  # noqa: ANN401  # whatever a caller gave
    if isinstance(value, str | bytes | Mapping | AbstractSet):
        return False
    return isinstance(value, Sequence) or (hasattr(value, "tolist") and getattr(value, "ndim", 0) > 0)


def _row(kind: Kind) -> Kind:
    def parts(value: Any) -> Iterator[Part]:  # noqa: ANN401  # a row
        """Return the parts that are judged one by one."""
        return ((f"[{i}]", part, kind) for i, part in enumerate(value))

    return Kind(_is_row, f"a tuple or list, each entry {kind.accepted}", parts)


def _row_of_length(kinds: Sequence[Kind]) -> Kind:
    def parts(value: Any) -> Iterator[Part]:  # noqa: ANN401  # a row
        """Return the parts that are judged one by one."""
        return ((f"[{i}]", part, kind) for i, (part, kind) in enumerate(zip(value, kinds, strict=True)))

    accepted = " and ".join(kind.accepted for kind in kinds) if len({kind.accepted for kind in kinds}) > 1 else f"each {kinds[0].accepted}"
    return Kind(lambda value: _is_row(value) and len(value) == len(kinds), f"{len(kinds)} entries, {accepted}", parts)


def _table(key: Kind, value: Kind) -> Kind:
    def parts(table: Mapping[Any, Any]) -> Iterator[Part]:
        """Return the parts that are judged one by one."""
        for name, part in table.items():
            yield f": the key {name!r}", name, key
            yield f"[{name!r}]", part, value

    return Kind(lambda table: isinstance(table, Mapping), f"a dict from {key.accepted} to {value.accepted}", parts)


def _one_of(kinds: Sequence[Kind]) -> Kind:
    if len(kinds) == 1:
        return kinds[0]
    last = [kind for kind in kinds if kind.accepted != "None"] + [kind for kind in kinds if kind.accepted == "None"]
    accepted = " or ".join(dict.fromkeys(kind.accepted for kind in last))
    containers = [kind for kind in kinds if kind.parts is not None]
    if len(containers) == 1:  # so that an error says which entry it is
        (only,) = containers
        others = [kind for kind in kinds if kind is not only]

        def parts(value: Any) -> Iterator[Part]:  # noqa: ANN401  # whatever a caller gave
            """Return the parts that are judged one by one."""
            return iter(()) if any(kind.accepts(value) for kind in others) else (only.parts or (lambda _: iter(())))(value)

        return Kind(lambda value: any(kind.passes(value) for kind in kinds), accepted, parts)
    if len(kinds) == 2 and kinds[1] is _PLAIN[NoneType]:
        passes = kinds[0].accepts
        return Kind(lambda value: value is None or passes(value), accepted)
    return Kind(lambda value: any(kind.accepts(value) for kind in kinds), accepted)


def _instance_of(family: type) -> Kind:
    """Return what accepts instances: of a family by its members' names, else by the name of the class."""
    leaves = sorted({leaf.__name__ for leaf in _leaves(family) if _is_public(leaf)})
    accepted = f"one of {', '.join(leaves)}" if inspect.isabstract(family) and leaves else f"a {family.__name__}"
    accepted_types: set[type] = set()  # classes of values that were accepted: an abstract base takes long to tell

    def passes(value: Any) -> bool:  # noqa: ANN401  # whatever a caller gave
        """Return whether it is of the family, at once where its class was met before."""
        return type(value) in accepted_types or (isinstance(value, family) and not accepted_types.add(type(value)))

    return Kind(passes, accepted)


def _is_public(leaf: type) -> bool:
    """Whether a caller can know of a class: one of the package's public names, or the caller's own."""
    name, module = leaf.__name__, leaf.__module__
    return name in sys.modules["obsdesign"].__all__ if module.startswith("obsdesign.") else not name.startswith("_")


def _leaves(family: type) -> Iterator[type]:
    for subclass in type.__subclasses__(family):
        yield from _leaves(subclass)
    if not inspect.isabstract(family):
        yield family

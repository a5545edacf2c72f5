"""Finding the members of a family: one file, one final leaf class, known under the file's name."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from types import ModuleType


def kinds(package: ModuleType) -> tuple[str, ...]:
    """Return the names a scenario may use: the files of the package, save for `abstract` and those that begin with _."""
    names = (info.name for info in pkgutil.iter_modules(package.__path__))
    return tuple(sorted(name for name in names if name != "abstract" and not name.startswith("_")))


def leaf(package: ModuleType, kind: str) -> type:
    """Return the one concrete class that the file `kind` of the package defines."""
    module = importlib.import_module(f"{package.__name__}.{kind}")
    classes = [member for _, member in inspect.getmembers(module, inspect.isclass) if member.__module__ == module.__name__]
    (member_class,) = classes
    return member_class

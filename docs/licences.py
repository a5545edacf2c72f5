"""Write docs/licences.md: the licence of every package that a plain install of obsdesign brings, and of the extras for users."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, metadata, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

EXTRAS = ("ardupilot", "px4", "ros", "sbml")
FILE = Path(__file__).parent / "licences.md"
_LONG = 60  # characters: what is longer is the whole text


def closure(requirements: Iterable[str]) -> set[str]:
    """Return the names of all packages that requirements bring here, with the extras that they name."""
    seen: set[tuple[str, frozenset[str]]] = set()
    waiting = list(map(Requirement, requirements))
    while waiting:
        requirement = waiting.pop()
        key = (canonicalize_name(requirement.name), frozenset(requirement.extras))
        if key not in seen:
            seen.add(key)
            waiting += _needed(*key)
    return {name for name, _ in seen}


def declared(extras: Iterable[str] = ()) -> list[str]:
    """Return what pyproject.toml says that obsdesign needs, with these of its extras."""
    project = tomllib.loads((FILE.parent.parent / "pyproject.toml").read_text())["project"]
    return [*project["dependencies"], *(text for extra in extras for text in project["optional-dependencies"][extra])]


def _needed(name: str, extras: frozenset[str]) -> Iterator[Requirement]:
    try:
        texts = requires(name) or ()
    except PackageNotFoundError:  # for another system or Python
        return
    for requirement in map(Requirement, texts):
        if requirement.marker is None or any(requirement.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            yield requirement


def licence(package: str) -> str:
    """Return what a package says of its licence: SPDX expression, classifiers or text."""
    about = metadata(package)
    entries = [entry.rpartition(" :: ")[2] for entry in about.get_all("Classifier") or () if entry.startswith("License ::")]
    classified = [entry for entry in entries if entry != "OSI Approved"]
    said = about.get("License-Expression") or ", ".join(classified) or about.get("License") or "not said"
    return re.sub(r"\s+", " ", said.strip().partition("\n")[0])[:_LONG]


def page() -> str:
    """Return the text of the page."""
    plain = closure(declared())
    extra = closure(declared(EXTRAS)) - plain
    about = "obsdesign itself is under the MIT licence. `docs/licences.py` writes this page from what the packages say."
    lines = ["# Licences", "", about, ""]
    for title, names in (("What a plain install brings", plain), (f"What the extras {', '.join(EXTRAS)} add", extra)):
        lines += [f"## {title}", "", "| package | licence |", "|---|---|"]
        lines += [f"| {name} | {licence(name)} |" for name in sorted(names) if is_installed(name)]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def is_installed(name: str) -> bool:
    """Whether a package is there to be asked."""
    try:
        metadata(name)
    except PackageNotFoundError:
        return False
    return True


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")

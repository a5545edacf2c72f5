"""What keeps the code readable: names, documentation, one place for one idea. CONTRIBUTING.md says why."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from conftest import ROOT

MODULES = {path: ast.parse(path.read_text()) for path in sorted((ROOT / "obsdesign").rglob("*.py"))}
FILLERS = frozenset(("found", "each", "one", "other", "known", "kept", "now", "more", "least", "most", "own", "there", "here"))
PARTICIPLE = re.compile(r"_*[a-z]{2,}(ed|en|wn|rn|lt|id|ound|osen)$")
NO_PARTICIPLES = re.compile(
    "seed|need|speed|feed|token|open|listen|hidden|return|turn|round|bound|sound|ground|grid|valid|mid|solid|mixed|given|then|tighten|whiten"
)
MAY_REPEAT = frozenset(("__init__", "abstract", "problem"))
MAY_CHANGE = {
    "Interrupts.__call__": "a handler of signals has to remember that it was called",
    "Interrupts.report_once": "says a thing once",
    "Scan._entry": "machine code takes the place of the virtual machine: the same numbers bit for bit, under the lock of all loops",
    "_Stages.__call__": "a stopwatch, alive for one run of a study",
}
LONGEST_REPEAT = 12


@cache
def nodes(tree: ast.AST) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree))


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    return (node for node in nodes(tree) if isinstance(node, ast.FunctionDef))


def classes(tree: ast.AST) -> Iterator[ast.ClassDef]:
    return (node for node in nodes(tree) if isinstance(node, ast.ClassDef))


def bound_names(tree: ast.AST) -> Iterator[str]:
    for node in nodes(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg) and node.arg not in ("self", "cls"):
            yield node.arg


def first_word(name: str) -> str:
    return name.lstrip("_").split("_")[0]


def is_participle(word: str) -> bool:
    return bool(PARTICIPLE.match(word)) and not NO_PARTICIPLES.fullmatch(word)


def returns_a_boolean(function: ast.FunctionDef) -> bool:
    return function.returns is not None and ast.unparse(function.returns) in ("bool", "np.ndarray", "ca.SX")


def where(path: Path, node: ast.stmt | ast.expr) -> str:
    return f"{path.relative_to(ROOT)}:{node.lineno}"


def test_variables_are_named_for_what_they_hold():
    names = [name for tree in MODULES.values() for name in bound_names(tree)]
    assert sum(name in FILLERS for name in names) < 0.005 * len(names)


def test_functions_are_verbs_or_nouns():
    every = [(path, function) for path, tree in MODULES.items() for function in functions(tree)]
    participles = [(path, function) for path, function in every if is_participle(first_word(function.name))]
    assert len(participles) < 0.03 * len(every)
    bare = [pair for pair in participles if "_" not in pair[1].name.strip("_") and not returns_a_boolean(pair[1])]
    assert [f"{where(path, function)} {function.name}" for path, function in bare] == []


def test_a_class_name_has_one_meaning():
    names = Counter(node.name for tree in MODULES.values() for node in classes(tree))
    assert [name for name, count in names.items() if count > 1] == []


def test_a_module_name_stands_at_most_twice():
    names = Counter(path.stem for path in MODULES)
    assert [name for name, count in names.items() if count > 2 and name not in MAY_REPEAT] == []


def test_what_is_public_is_documented():
    undocumented = []
    for path, tree in MODULES.items():
        if path.name not in ("__init__.py", "__main__.py") and not ast.get_docstring(tree):
            undocumented.append(str(path))
        for owner in (tree, *classes(tree)):
            for node in getattr(owner, "body", ()):
                if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_") and not ast.get_docstring(node):
                    undocumented.append(f"{where(path, node)} {node.name}")
    assert undocumented == []


def test_records_do_not_change():
    changing = []
    for path, tree in MODULES.items():
        for owner in classes(tree):
            for method in (node for node in owner.body if isinstance(node, ast.FunctionDef)):
                targets = [
                    target
                    for node in ast.walk(method)
                    if isinstance(node, ast.Assign | ast.AugAssign | ast.AnnAssign)
                    for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
                    for target in ast.walk(target)
                ]
                changes = any(
                    isinstance(target, ast.Attribute) and isinstance(target.value, ast.Name) and target.value.id == "self"
                    for target in targets
                    if isinstance(getattr(target, "ctx", None), ast.Store)
                )
                if changes and method.name != "__init__" and f"{owner.name}.{method.name}" not in MAY_CHANGE:
                    changing.append(f"{where(path, method)} {owner.name}.{method.name}")
    assert changing == []


def test_nothing_vanishes_under_optimisation_and_only_the_command_line_prints():
    wrong = []
    for path, tree in MODULES.items():
        for node in nodes(tree):
            prints = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print" and "cli" not in path.parts
            if isinstance(node, ast.Assert) or prints:
                wrong.append(where(path, node))
    assert wrong == []


def test_one_idea_has_one_place():
    """No two places of more than 12 equal lines, imports, blank lines and comments aside."""
    seen: dict[tuple[str, ...], str] = {}
    repeats = []
    for path in MODULES:
        lines = [(i, line.strip()) for i, line in enumerate(path.read_text().splitlines(), 1)]
        lines = [(i, line) for i, line in lines if line and not line.startswith(("#", "from ", "import "))]
        for k in range(len(lines) - LONGEST_REPEAT):
            window = tuple(line for _, line in lines[k : k + LONGEST_REPEAT + 1])
            place = f"{path.relative_to(ROOT)}:{lines[k][0]}"
            if window in seen and seen[window] != place:
                repeats.append((seen[window], place))
            seen.setdefault(window, place)
    assert repeats == []

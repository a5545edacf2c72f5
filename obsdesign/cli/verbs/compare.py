"""`obsdesign compare`: two results beside each other."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from obsdesign.cli.folders import require_writable
from obsdesign.cli.verb import QUIET, Argument, Outcome, Verb, out_argument

_PAGE = "comparison.html"


def compare(options: Namespace) -> Outcome:
    """Say what changed between two results, in the question and in the answers."""
    from obsdesign.files import write_files
    from obsdesign.report.comparison import changes_table, compare_results, numbers_table
    from obsdesign.report.folder import read_result
    from obsdesign.report.terminal import render

    first, second = read_result(options.first), read_result(options.second)
    names = _names(options.first, options.second)
    comparison = compare_results(first, second)
    document = {"first": str(options.first), "second": str(options.second), **comparison.document()}
    shown = [render(numbers_table(comparison, names)), *comparison.notes]
    if comparison.changes:
        shown.insert(0, render(changes_table(comparison, names)))
    if options.out is not None:
        require_writable(options.out)
        from obsdesign.report.comparison_page import comparison_page
        from obsdesign.report.study_record import study_of

        studies = (study_of(first, options.first), study_of(second, options.second))
        write_files(options.out, {_PAGE: comparison_page(comparison, studies, names)})
        shown.append(f"\nWritten: {options.out}/{_PAGE}")
        document["page"] = str(options.out / _PAGE)
    return Outcome(document, tuple(shown))


def _names(first: Path, second: Path) -> tuple[str, str]:
    """What the two are called: their folders, or the whole paths where these are the same."""
    short = [(path if path.is_dir() else path.parent).resolve().name for path in (first, second)]
    return (short[0], short[1]) if short[0] != short[1] else (str(first), str(second))


VERB = Verb(
    name="compare",
    what="put two results beside each other: what changed in the question, and in the answers",
    action=compare,
    example="compare reports/before reports/after --out reports/comparison",
    arguments=(
        Argument("first", "result.json of a run, or its folder", Path, completes="files"),
        Argument("second", "the same of another one", Path, completes="files"),
        out_argument(f"folder for {_PAGE}, with pictures (default: none)"),
        QUIET,
    ),
)

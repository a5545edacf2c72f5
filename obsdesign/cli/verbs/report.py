"""`obsdesign report`: the page of an earlier run, built again."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from obsdesign.cli.folders import require_writable
from obsdesign.cli.verb import QUIET, RESULT, Outcome, Verb, out_argument


def report(options: Namespace) -> Outcome:
    """Build the page of a result again, to the same bytes; nothing is computed anew."""
    from obsdesign.report.folder import read_result, write_page
    from obsdesign.report.study_record import study_of
    from obsdesign.report.terminal import summary_of

    result = read_result(options.result)
    folder: Path = options.out or (options.result if options.result.is_dir() else options.result.parent)
    require_writable(folder)
    study = study_of(result, options.result)
    write_page(folder, result, study)
    shown = (summary_of(result) if study.checks else "", f"\nWritten: {folder}/report.html")
    return Outcome({"page": str(folder / "report.html"), "title": result.scenario.title}, shown)


VERB = Verb(
    name="report",
    what="build the page of an earlier run again from its result.json",
    action=report,
    example="report reports/my/result.json",
    arguments=(RESULT, out_argument("folder for report.html (default: that of the result)"), QUIET),
)

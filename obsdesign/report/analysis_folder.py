"""Writing the verdicts of a scenario, and showing them on a terminal."""

from __future__ import annotations

from pathlib import Path

from rich.console import Group

from obsdesign.files import write_files
from obsdesign.report.analysis_document import AnalysisDocument
from obsdesign.report.analysis_page import analysis_page
from obsdesign.report.document_parts import as_json
from obsdesign.report.sections.observability import subsets_table
from obsdesign.report.terminal import render
from obsdesign.study.analysis_study import AnalysisStudy, cases_apart

FILES = ("analysis.html", "analysis.json")


def write_analysis(folder: Path, study: AnalysisStudy, document: AnalysisDocument) -> None:
    """Write the page and the JSON: both or none. Raises InputError for a folder that cannot be written."""
    write_files(folder, dict(zip(FILES, (analysis_page(study), as_json(document)), strict=True)))


def analysis_summary(study: AnalysisStudy) -> Group:
    """Return what a terminal shows: the table of all cases, letters for what is hidden."""
    return Group(render(subsets_table(cases_apart(study))))

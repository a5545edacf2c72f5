"""How well? What all sensors together know along given paths."""

from __future__ import annotations

from obsdesign.report.figures import input_histories, spectra
from obsdesign.report.names import criterion_name, path_in_words
from obsdesign.report.number_format import join, numeral
from obsdesign.report.section import Section
from obsdesign.report.sections._paths import contributions_table, path_value, paths_table
from obsdesign.study.record import Study


def section(study: Study) -> Section:
    """Return the answer to "How well?"."""
    pictures = (spectra.picture(study), input_histories.picture(study))
    contributions = tuple(contributions_table(path_study) for path_study in study.each)
    return Section("how", "How well?", _answer(study), pictures, (paths_table(study), *contributions))


def _answer(study: Study) -> str:
    """Say how much all sensors know on each given path."""
    name = criterion_name(study)
    values = [f"{numeral(path_value(study, candidate.name))} on {path_in_words(candidate.name)}" for candidate in study.candidates]
    return f"With all sensors on, {name} is {join(values)}."

"""A study as one self-contained HTML page: the sections, laid out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from obsdesign.report.number_format import plain
from obsdesign.report.page import environment
from obsdesign.report.question_to_document import versions
from obsdesign.report.section import Section
from obsdesign.report.sections import codesign, design, flight, observability, rating, schedule, summary, validation, way_points
from obsdesign.report.sections.glossary import glossary
from obsdesign.study.record import Study


def page_of(study: Study, made_with: Mapping[str, str] | None = None) -> str:
    """Return the report of a study: HTML without any reference to the network; the same study gives the same text.

    made_with: the versions that made its numbers; None = those that are installed.
    """
    return (
        environment()
        .get_template("page.html.j2")
        .render(
            title=study.scenario.title,
            question=study.scenario.question,
            answer=summary.answer(study),
            headline=summary.headline(study),
            parts=_number_questions(_sections(study)),
            command=_command(study),
            versions=versions() if made_with is None else made_with,
            file=Path(study.scenario.file).name,
            digest=study.scenario.digest,
            seed=study.seed,
            glossary=glossary(study),
        )
    )


def _sections(study: Study) -> tuple[Section, ...]:
    return (*_question_sections(study), *((way_points.section(study),) if study.way_points else ()))


def _question_sections(study: Study) -> tuple[Section, ...]:
    can = (observability.section(study),) if study.designs or study.analyses else ()
    if not study.designs:
        return (*can, rating.section(study), *(section for path_study in study.each for section in _sections_along(path_study)))
    together = () if study.joint is None else (codesign.section(study, study.joint),)
    settings = study.scenario.flight
    flown = () if study.flight is None or settings is None else (flight.section(study, study.flight, settings),)
    return (*can, design.section(study), schedule.section(study), *together, validation.section(study), *flown)


def _sections_along(study: Study) -> tuple[Section, ...]:
    """The sections on a given path."""
    return (schedule.section(study), *((validation.section(study),) if study.checks else ()))


def _number_questions(sections: tuple[Section, ...]) -> tuple[Section, ...]:
    """The questions with numbers; those asked again of another path keep theirs."""
    asked = list(dict.fromkeys(section.question.partition("?")[0] for section in sections))
    return tuple(replace(each, question=f"{asked.index(each.question.partition('?')[0]) + 1} {each.question}") for each in sections)


def _command(study: Study) -> str:
    file = Path(study.scenario.file).name or "scenario.toml"
    if not study.checks:
        return f"obsdesign select trajectory.csv --scenario {file} --seed {plain(study.seed)} --out report"
    return f"obsdesign run {file} --seed {plain(study.seed)} --out report"

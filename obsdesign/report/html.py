"""A study as one self-contained HTML page."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import jinja2
from markupsafe import Markup, escape

from obsdesign.report import captions, tables, wording
from obsdesign.report import derived_quantities as facts
from obsdesign.report.figures.clearance import clearance_figure
from obsdesign.report.figures.consistency import consistency_figure
from obsdesign.report.figures.eigenvectors import eigenvectors_figure
from obsdesign.report.figures.errors import errors_figure
from obsdesign.report.figures.flight_estimates import flight_estimates_figure
from obsdesign.report.figures.flight_map import flight_map_figure
from obsdesign.report.figures.front import front_figure
from obsdesign.report.figures.inputs import inputs_figure
from obsdesign.report.figures.joint_map import joint_map_figure
from obsdesign.report.figures.path import path_figure
from obsdesign.report.figures.raster import raster_figure
from obsdesign.report.figures.regret import regret_figure
from obsdesign.report.figures.rivals import rivals_figure
from obsdesign.report.figures.spectrum import spectrum_figure
from obsdesign.report.names import criterion_name, gap_in_words, path_in_words
from obsdesign.report.number_format import numeral, percent, plain
from obsdesign.report.sections import codesign as codesign_section
from obsdesign.report.sections import flight as flight_section
from obsdesign.report.sections import schedule as schedule_section
from obsdesign.report.sections.design import design_in_words
from obsdesign.report.tables import Table
from obsdesign.report.to_document import versions
from obsdesign.study.record import Study


@dataclass(frozen=True)
class Picture:
    """An inline SVG and the sentence that says what it means."""

    svg: str
    caption: str


@dataclass(frozen=True)
class Part:
    """One of the four questions with its answer and what backs it."""

    key: str
    question: str
    answer: str
    pictures: tuple[Picture, ...]
    tables: tuple[Table, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class KeyNumber:
    """A number that stands for a part at the top of the page."""

    part: str
    number: str
    meaning: str


def page_of(study: Study) -> str:
    """Return the report of a study: HTML without any reference to the network; the same study gives the same text."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("obsdesign.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["typeset"] = _typeset
    return environment.get_template("page.html.j2").render(
        scenario=study.scenario,
        answer=_answer(study),
        headline=_headline(study),
        parts=_number_questions(_parts(study)),
        command=_command(study),
        versions=versions(),
        file=Path(study.scenario.file).name,
        seed=study.seed,
        glossary=captions.glossary(study),
    )


def _typeset(text: str) -> Markup:
    """Escape a text and set λmin with its index below."""
    return Markup(re.sub("λmin", "λ<sub>min</sub>", str(escape(text))))


def _parts(study: Study) -> tuple[Part, ...]:
    if study.designs:
        return (
            _observability_part(study),
            _design_part(study),
            _schedule_part(study),
            *_codesign_part(study),
            _validation_part(study),
            *_flight_part(study),
        )
    can = (_observability_part(study),) if study.analyses else ()
    along = [
        part
        for path_study in study.each
        for part in (_schedule_part(path_study), *((_validation_part(path_study),) if path_study.checks else ()))
    ]
    return (*can, _rating_part(study), *along)


def _number_questions(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    """The questions with numbers; those asked again of another path keep theirs."""
    asked = list(dict.fromkeys(part.question.partition("?")[0] for part in parts))
    return tuple(replace(part, question=f"{asked.index(part.question.partition('?')[0]) + 1} {part.question}") for part in parts)


def _answer(study: Study) -> str:
    """One sentence for the designed path, or one for each given path."""
    if not study.checks:
        return schedule_section.schedule_answer(study)
    return " ".join(wording.study_answer(path_study) for path_study in study.each)


def _headline(study: Study) -> tuple[KeyNumber, ...]:
    everything = [analysis.verdict for analysis in study.analyses if set(analysis.sensors) == set(study.scenario.sensor_names)]
    dimension, n = max((verdict.dimension for verdict in everything), default=0), len(study.scenario.state_names)
    can = KeyNumber("can", f"{dimension} of {n}", "dimensions seen with all sensors")
    along = [number for path_study in study.each for number in _headline_along(path_study)]
    return (*((can,) if everything else ()), *along, *_headline_of_flight(study))


def _headline_along(study: Study) -> tuple[KeyNumber, ...]:
    value, path = facts.value_of(study, study.main.qualities[0]), path_in_words(study.about)
    how = KeyNumber(f"how{facts.drawing_suffix(study)}" if study.designs else "how", numeral(value), f"{criterion_name(study)} of {path}")
    on = "" if study.designs or len(study.candidates) == 1 else f", {path}"
    which = KeyNumber(f"which{facts.drawing_suffix(study)}", gap_in_words(study), f"gap between schedule and bound{on}")
    first = () if on else (how,)
    if not study.checks:
        return *first, which
    check = study.check(study.about, facts.CHOSEN).validation
    return (
        *first,
        which,
        KeyNumber(f"holds{facts.drawing_suffix(study)}", percent(check.in_band), f"of the instants with NEES in its band{on}"),
    )


def _headline_of_flight(study: Study) -> tuple[KeyNumber, ...]:
    if study.flight is None:
        return ()
    return (KeyNumber("flight", f"{sum(study.flight.feasible)} of {len(study.flight.feasible)}", "plans in flight keep every limit"),)


def _observability_part(study: Study) -> Part:
    hidden = tuple(tables.hidden_table(study, analysis) for suite in study.suites for analysis in facts.unobservable_analyses(study, suite))
    return Part(
        "can", "Can it?", wording.observability_answer(study), (), (tables.subsets_table(study), *hidden), (wording.proof_note(study),)
    )


def _design_part(study: Study) -> Part:
    drawings = (
        (path_figure, captions.map_caption),
        (spectrum_figure, captions.spectrum_caption),
        (clearance_figure, captions.clearance_caption),
        (eigenvectors_figure, captions.eigenvectors_caption),
        (inputs_figure, captions.inputs_caption),
    )
    shown = tuple(Picture(svg, caption(study)) for drawing, caption in drawings if (svg := drawing(study)))
    starts = tuple(tables.starts_table(study, i) for i in range(len(study.suites)))
    design_notes = tuple(design_in_words(study, i) for i in range(len(study.suites)))
    notes = (*design_notes, *wording.cap_notes(study), wording.weave_in_words(study))
    return Part(
        "how", "How?", wording.path_answer(study), shown, (tables.paths_table(study), tables.contributions_table(study), *starts), notes
    )


def _rating_part(study: Study) -> Part:
    """What all sensors together know along given paths."""
    drawings = ((spectrum_figure, captions.spectrum_caption), (inputs_figure, captions.inputs_caption))
    shown = tuple(Picture(svg, caption(study)) for drawing, caption in drawings if (svg := drawing(study)))
    contributions = tuple(tables.contributions_table(path_study) for path_study in study.each)
    return Part("how", "How well?", wording.rating_answer(study), shown, (tables.paths_table(study), *contributions))


def _schedule_part(study: Study) -> Part:
    drawings = (
        *(() if study.designs else ((path_figure, captions.map_caption),)),
        (raster_figure, schedule_section.raster_caption),
        (regret_figure, schedule_section.regret_caption),
        (rivals_figure, schedule_section.rivals_caption),
        (front_figure, schedule_section.front_caption),
    )
    pictures = tuple(Picture(svg, caption(study)) for drawing, caption in drawings if (svg := drawing(study)))
    losses = (schedule_section.losses_table(study),) if study.selection.losses else ()
    shown = (schedule_section.usage_table(study), schedule_section.schedules_table(study), *losses)
    return Part(
        f"which{facts.drawing_suffix(study)}",
        f"Which?{_path_suffix(study)}",
        schedule_section.schedule_answer(study),
        pictures,
        shown,
        schedule_section.method_notes(study),
    )


def _codesign_part(study: Study) -> tuple[Part, ...]:
    joint = study.joint
    if joint is None:
        return ()
    drawn = joint_map_figure(study)
    pictures = (Picture(drawn, codesign_section.joint_map_caption(study)),) if drawn else ()
    return (
        Part(
            "together",
            "Together?",
            codesign_section.codesign_answer(study, joint),
            pictures,
            (codesign_section.answers_table(study, joint),),
        ),
    )


def _path_suffix(study: Study) -> str:
    """Which of several given paths a question is about."""
    words = path_in_words(study.about)
    return "" if study.designs or len(study.candidates) == 1 else f" {words[:1].upper()}{words[1:]}"


def _validation_part(study: Study) -> Part:
    pictures = (
        Picture(errors_figure(study), captions.errors_caption(study)),
        Picture(consistency_figure(study), captions.consistency_caption(study)),
    )
    key, question = f"holds{facts.drawing_suffix(study)}", f"Does it hold?{_path_suffix(study)}"
    return Part(key, question, wording.validation_answer(study), pictures, (tables.checks_table(study),), wording.consistency_notes(study))


def _flight_part(study: Study) -> tuple[Part, ...]:
    flight, settings = study.flight, study.scenario.flight
    if flight is None or settings is None:
        return ()
    drawings = (
        (flight_map_figure, flight_section.flight_map_caption),
        (flight_estimates_figure, flight_section.flight_estimates_caption),
    )
    shown = tuple(Picture(svg, caption(study)) for drawing, caption in drawings if (svg := drawing(study)))
    answer = flight_section.flight_answer(study, flight, settings)
    return (
        Part(
            "flight", "In flight?", answer, shown, (flight_section.errors_table(study, flight), flight_section.plans_table(study, flight))
        ),
    )


def _command(study: Study) -> str:
    file = Path(study.scenario.file).name or "scenario.toml"
    if not study.checks:
        return f"obsdesign select trajectory.csv --scenario {file} --seed {plain(study.seed)} --out report"
    return f"obsdesign run {file} --seed {plain(study.seed)} --out report"

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
from obsdesign.report.names import gap_in_words, path_in_words
from obsdesign.report.number_format import percent, plain, rounded
from obsdesign.report.sections import codesign as together
from obsdesign.report.sections import flight as flying
from obsdesign.report.sections import schedule as scheduling
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
        parts=_numbered(_parts(study)),
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
        return (_can(study), _how(study), _which(study), *_together(study), _holds(study), *_flies(study))
    can = (_can(study),) if study.analyses else ()
    along = [part for each in study.each for part in (_which(each), *((_holds(each),) if each.checks else ()))]
    return (*can, _how_well(study), *along)


def _numbered(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    """The questions with numbers; those asked again of another path keep theirs."""
    asked = list(dict.fromkeys(part.question.partition("?")[0] for part in parts))
    return tuple(replace(part, question=f"{asked.index(part.question.partition('?')[0]) + 1} {part.question}") for part in parts)


def _answer(study: Study) -> str:
    """One sentence for the designed path, or one for each given path."""
    if not study.checks:
        return scheduling.chosen(study)
    return " ".join(wording.answer(each) for each in study.each)


def _headline(study: Study) -> tuple[KeyNumber, ...]:
    everything = [each.verdict for each in study.analyses if set(each.sensors) == set(study.scenario.sensor_names)]
    dimension, n = max((verdict.dimension for verdict in everything), default=0), len(study.scenario.state_names)
    can = KeyNumber("can", f"{dimension} of {n}", "dimensions seen with all sensors")
    along = [number for each in study.each for number in _headline_along(each)]
    return (*((can,) if everything else ()), *along, *_headline_of_flight(study))


def _headline_along(study: Study) -> tuple[KeyNumber, ...]:
    value, path = facts.value_of(study, study.main.qualities[0]), path_in_words(study.about)
    how = KeyNumber(f"how{facts.mark(study)}" if study.designs else "how", rounded(value), f"{wording.criterion_name(study)} of {path}")
    on = "" if study.designs or len(study.candidates) == 1 else f", {path}"
    which = KeyNumber(f"which{facts.mark(study)}", gap_in_words(study), f"gap between schedule and bound{on}")
    first = () if on else (how,)
    if not study.checks:
        return *first, which
    check = study.check(study.about, facts.CHOSEN).validation
    return *first, which, KeyNumber(f"holds{facts.mark(study)}", percent(check.in_band), f"of the instants with NEES in its band{on}")


def _headline_of_flight(study: Study) -> tuple[KeyNumber, ...]:
    if study.flight is None:
        return ()
    return (KeyNumber("flight", f"{sum(study.flight.feasible)} of {len(study.flight.feasible)}", "plans in flight keep every limit"),)


def _can(study: Study) -> Part:
    hidden = tuple(tables.hidden_table(study, each) for suite in study.suites for each in facts.incomplete(study, suite))
    return Part("can", "Can it?", wording.seen(study), (), (tables.subsets_table(study), *hidden), (wording.proven(study),))


def _how(study: Study) -> Part:
    drawings = (
        (path_figure, captions.on_the_map),
        (spectrum_figure, captions.on_the_spectrum),
        (clearance_figure, captions.on_the_clearance),
        (eigenvectors_figure, captions.on_the_eigenvectors),
        (inputs_figure, captions.on_the_inputs),
    )
    shown = tuple(Picture(svg, caption(study)) for drawing, caption in drawings if (svg := drawing(study)))
    starts = tuple(tables.starts_table(study, i) for i in range(len(study.suites)))
    found = tuple(design_in_words(study, i) for i in range(len(study.suites)))
    notes = (*found, *wording.caps(study), wording.weave_in_words(study))
    return Part("how", "How?", wording.taken(study), shown, (tables.paths_table(study), tables.contributions_table(study), *starts), notes)


def _how_well(study: Study) -> Part:
    """What all sensors together know along given paths."""
    drawings = ((spectrum_figure, captions.on_the_spectrum), (inputs_figure, captions.on_the_inputs))
    shown = tuple(Picture(svg, caption(study)) for drawing, caption in drawings if (svg := drawing(study)))
    said = tuple(tables.contributions_table(each) for each in study.each)
    return Part("how", "How well?", wording.rated(study), shown, (tables.paths_table(study), *said))


def _which(study: Study) -> Part:
    drawings = (
        *(() if study.designs else ((path_figure, captions.on_the_map),)),
        (raster_figure, scheduling.on_the_raster),
        (regret_figure, scheduling.on_the_regret),
        (rivals_figure, scheduling.on_the_rivals),
        (front_figure, scheduling.on_the_front),
    )
    pictures = tuple(Picture(svg, caption(study)) for drawing, caption in drawings if (svg := drawing(study)))
    losses = (scheduling.losses_table(study),) if study.selection.losses else ()
    shown = (scheduling.where_table(study), scheduling.schedules_table(study), *losses)
    return Part(f"which{facts.mark(study)}", f"Which?{_of(study)}", scheduling.chosen(study), pictures, shown, scheduling.explained(study))


def _together(study: Study) -> tuple[Part, ...]:
    joint = study.joint
    if joint is None:
        return ()
    drawn = joint_map_figure(study)
    pictures = (Picture(drawn, together.on_the_joint_map(study)),) if drawn else ()
    return (Part("together", "Together?", together.found_together(study, joint), pictures, (together.answers_table(study, joint),)),)


def _of(study: Study) -> str:
    """Which of several given paths a question is about."""
    words = path_in_words(study.about)
    return "" if study.designs or len(study.candidates) == 1 else f" {words[:1].upper()}{words[1:]}"


def _holds(study: Study) -> Part:
    pictures = (
        Picture(errors_figure(study), captions.on_the_errors(study)),
        Picture(consistency_figure(study), captions.on_the_consistency(study)),
    )
    key, question = f"holds{facts.mark(study)}", f"Does it hold?{_of(study)}"
    return Part(key, question, wording.held(study), pictures, (tables.checks_table(study),), wording.reasons(study))


def _flies(study: Study) -> tuple[Part, ...]:
    flight, asked = study.flight, study.scenario.flight
    if flight is None or asked is None:
        return ()
    drawings = (
        (flight_map_figure, flying.on_the_flight_map),
        (flight_estimates_figure, flying.on_the_flight_estimates),
    )
    shown = tuple(Picture(svg, caption(study)) for drawing, caption in drawings if (svg := drawing(study)))
    answered = flying.in_flight(study, flight, asked)
    return (Part("flight", "In flight?", answered, shown, (flying.errors_table(study, flight), flying.plans_table(study, flight))),)


def _command(study: Study) -> str:
    file = Path(study.scenario.file).name or "scenario.toml"
    if not study.checks:
        return f"obsdesign select trajectory.csv --scenario {file} --seed {plain(study.seed)} --out report"
    return f"obsdesign run {file} --seed {plain(study.seed)} --out report"

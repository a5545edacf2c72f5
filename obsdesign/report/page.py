"""A study as one self-contained HTML page."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import jinja2
from markupsafe import Markup, escape

from obsdesign.report import captions, facts, flying, tables, wording
from obsdesign.report.designing import design_in_words
from obsdesign.report.figures.clearance import clearance_figure
from obsdesign.report.figures.consistency import consistency_figure
from obsdesign.report.figures.eigenvectors import eigenvectors_figure
from obsdesign.report.figures.errors import errors_figure
from obsdesign.report.figures.flight_estimates import flight_estimates_figure
from obsdesign.report.figures.flight_map import flight_map_figure
from obsdesign.report.figures.inputs import inputs_figure
from obsdesign.report.figures.path import path_figure
from obsdesign.report.figures.raster import raster_figure
from obsdesign.report.figures.rivals import rivals_figure
from obsdesign.report.figures.spectrum import spectrum_figure
from obsdesign.report.result import versions
from obsdesign.report.rounding import percent, plain, rounded
from obsdesign.report.tables import Table
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
        answer=wording.answer(study),
        headline=_headline(study),
        parts=(_can(study), _how(study), _which(study), _holds(study), *_flies(study)),
        command=_command(study),
        versions=versions(),
        file=Path(study.scenario.file).name,
        seed=study.seed,
        glossary=captions.glossary(study),
    )


def _typeset(text: str) -> Markup:
    """Escape a text and set λmin with its index below."""
    return Markup(re.sub("λmin", "λ<sub>min</sub>", str(escape(text))))


def _headline(study: Study) -> tuple[KeyNumber, ...]:
    everything = [each.verdict for each in study.analyses if set(each.sensors) == set(study.scenario.sensor_names)]
    value = facts.value_of(study, study.designed.qualities[0])
    schedule, check = study.selection.schedule, study.check(facts.DESIGNED, facts.CHOSEN).validation
    dimension, n = max(verdict.dimension for verdict in everything), len(study.scenario.state_names)
    return (
        KeyNumber("can", f"{dimension} of {n}", "dimensions seen with all sensors"),
        KeyNumber("how", rounded(value), f"{wording.criterion_name(study)} of the designed path"),
        KeyNumber("which", percent(schedule.gap), "gap between schedule and bound"),
        KeyNumber("holds", percent(check.in_band), "of the instants with NEES in its band"),
        *_headline_of_flight(study),
    )


def _headline_of_flight(study: Study) -> tuple[KeyNumber, ...]:
    if study.flight is None:
        return ()
    return (KeyNumber("flight", f"{sum(study.flight.feasible)} of {len(study.flight.feasible)}", "plans in flight keep every limit"),)


def _can(study: Study) -> Part:
    hidden = tuple(tables.hidden_table(study, each) for suite in study.suites for each in facts.incomplete(study, suite))
    return Part("can", "1 Can it?", wording.seen(study), (), (tables.subsets_table(study), *hidden), (wording.proven(study),))


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
    return Part(
        "how", "2 How?", wording.taken(study), shown, (tables.paths_table(study), tables.contributions_table(study), *starts), notes
    )


def _which(study: Study) -> Part:
    pictures = (
        Picture(raster_figure(study), captions.on_the_raster(study)),
        Picture(rivals_figure(study), captions.on_the_rivals(study)),
    )
    return Part("which", "3 Which?", wording.chosen(study), pictures, (tables.schedules_table(study),), (wording.relaxed(study),))


def _holds(study: Study) -> Part:
    pictures = (
        Picture(errors_figure(study), captions.on_the_errors(study)),
        Picture(consistency_figure(study), captions.on_the_consistency(study)),
    )
    return Part("holds", "4 Does it hold?", wording.held(study), pictures, (tables.checks_table(study),), wording.reasons(study))


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
    return (Part("flight", "5 In flight?", answered, shown, (flying.errors_table(study, flight), flying.plans_table(study, flight))),)


def _command(study: Study) -> str:
    file = Path(study.scenario.file).name or "scenario.toml"
    return f"obsdesign run {file} --seed {plain(study.seed)} --out report"

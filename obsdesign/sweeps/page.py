"""A sweep as one self-contained HTML page, and its table beside it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np

from obsdesign.files import write_files
from obsdesign.report.number_format import NOTHING, join, numeral
from obsdesign.report.page import environment
from obsdesign.report.question_to_document import versions
from obsdesign.report.section import Section
from obsdesign.report.sweep_figures import small_multiples, trade_off
from obsdesign.report.sweep_figures.small_multiples import Panel
from obsdesign.report.table import Entry, Table, TableColumn, Toned, tabulate
from obsdesign.scenario.schema import Scenario
from obsdesign.sweeps.headline import in_words, sense
from obsdesign.sweeps.sweep_record import Sweep, SweepRun

FILES = ("sweep.html", "sweep.csv")
_PANELS = 5  # of a picture
_ROWS = 100  # of the table on the page; the file has all
_COLUMNS = 6
_TRADE_OFFS = 2
_REPEATS = "seed"  # the key whose values are repetitions


def write_sweep(folder: Path, scenario: Scenario, sweep: Sweep) -> None:
    """Write the page and the table of a sweep. Raises InputError for a folder that cannot be written."""
    write_files(folder, dict(zip(FILES, (sweep_page(scenario, sweep), sweep.to_csv()), strict=True)))


def sweep_page(scenario: Scenario, sweep: Sweep) -> str:
    """Return the page: HTML without any reference to the network; the same sweep gives the same text."""
    panels = main_panels(scenario, sweep)
    parts = (*_pictures(sweep, panels), _runs_section(sweep, panels))
    template = environment().get_template("sweep.html.j2")
    question, answer = scenario.question, _answer(sweep)
    return template.render(title=scenario.title, question=question, answer=answer, headline=(), parts=parts, versions=versions())


def main_panels(scenario: Scenario, sweep: Sweep) -> dict[str, Panel]:
    """Return the numbers that differ between runs and of which one can say what is better, by key, the first few."""
    units = {state.name: state.unit for state in scenario.states}
    panels: dict[str, Panel] = {}
    for key in sweep.numbers:
        values = sweep.column(key)
        if sense(key) and values.dtype == float and len(np.unique(values[np.isfinite(values)])) > 1:
            unit = units.get(key.rsplit(".", 1)[-1], "") if "final_rmse" in key else ""
            panels[key] = Panel(in_words(key) + (f" [{unit}]" if unit else ""), values)
    return panels


def _answer(sweep: Sweep) -> str:
    """Say how many runs there were, and how many ended well."""
    failed, keys = len(sweep.failures), join(sweep.keys)
    ended = "All ended well." if not failed else f"{failed} of them failed; the table says why."
    return f"{len(sweep.runs)} runs of one scenario, with other values of {keys}. {ended}"


def _pictures(sweep: Sweep, panels: dict[str, Panel]) -> Iterator[Section]:
    """A section for what each key does, and one for the numbers that compete."""
    chosen = list(panels.values())[:_PANELS]
    varied = [key for key in sweep.keys if key != _REPEATS and len({repr(run.varied[key]) for run in sweep.runs}) > 1]
    if chosen and varied:
        pictures = (
            small_multiples.picture(f"key{i}", key, [run.varied[key] for run in sweep.runs], chosen) for i, key in enumerate(varied)
        )
        yield Section("keys", "What does each of them do?", "", tuple(pictures), ())
    pairs = list(competing(panels))[:_TRADE_OFFS]
    if pairs:
        drawn = (
            trade_off.picture(f"pair{i}", panels[first], panels[second], best_of_both(panels, first, second))
            for i, (first, second) in enumerate(pairs)
        )
        answer = "No run is best in both numbers: which of them to take is for you to say."
        yield Section("trade-offs", "What has to be given up for what?", answer, tuple(drawn), ())


def competing(panels: dict[str, Panel]) -> Iterator[tuple[str, str]]:
    """Yield pairs of numbers that tend to be better where the other is worse, and of which no run has the best of both."""
    from scipy.stats import rankdata

    for first, second in combinations(panels, 2):
        gains = np.stack([sense(key) * panels[key].values for key in (first, second)])
        gains = gains[:, np.isfinite(gains).all(axis=0)]
        is_constant = (np.ptp(gains, axis=1) == 0).any() if gains.size else True
        if (
            not is_constant
            and np.sum(np.prod([rankdata(row) - (len(row) + 1) / 2 for row in gains], axis=0)) < 0
            and not (gains == gains.max(axis=1)[:, None]).all(axis=0).any()
        ):
            yield first, second


def best_of_both(panels: dict[str, Panel], first: str, second: str) -> np.ndarray:
    """Return which runs (runs,) no other run beats: as good in both numbers, and better in one (Pareto)."""
    gains = np.stack([sense(key) * panels[key].values for key in (first, second)], axis=1)
    gains[~np.isfinite(gains).all(axis=1)] = -np.inf
    order = np.lexsort((-gains[:, 1], -gains[:, 0]))
    is_best, best_second = np.zeros(len(gains), dtype=bool), -np.inf
    for place, run in enumerate(order):
        ties = place and np.array_equal(gains[run], gains[order[place - 1]])
        is_best[run] = is_best[order[place - 1]] if ties else gains[run, 1] > best_second
        best_second = max(best_second, gains[run, 1])
    return is_best


def _runs_section(sweep: Sweep, panels: dict[str, Panel]) -> Section:
    notes = (f"The first {_ROWS} runs; sweep.csv has all {len(sweep.runs)}.",) if len(sweep.runs) > _ROWS else ()
    return Section("runs", "What came out of each run?", "", (), (_runs_table(sweep, panels),), notes)


def _runs_table(sweep: Sweep, panels: dict[str, Panel]) -> Table:
    """What was varied and the main numbers of each run, the best of each column marked."""
    chosen = dict(list(panels.items())[:_COLUMNS])
    heads = [TableColumn("run"), *map(TableColumn, sweep.keys), *(TableColumn(panel.label) for panel in chosen.values())]
    if sweep.failures:
        heads.append(TableColumn("error"))
    rows = [_row(sweep, run, place, chosen) for place, run in enumerate(sweep.runs[:_ROWS])]
    return tabulate("Runs", "The best of each column is green.", heads, rows)


def _row(sweep: Sweep, run: SweepRun, place: int, chosen: dict[str, Panel]) -> list[Entry]:
    varied = [", ".join(map(str, value)) if isinstance(value, list) else str(value) for value in run.varied.values()]
    numbers = [_highlight(panel.values, sense(key), place) for key, panel in chosen.items()]
    error = [Toned(run.error, "bad") if run.error else NOTHING] if sweep.failures else []
    return [run.name[:8], *varied, *numbers, *error]


def _highlight(values: np.ndarray, better: int, place: int) -> Entry:
    """Return a number, good where it is the best of its column."""
    is_best = bool(np.isfinite(values[place])) and better * values[place] == np.nanmax(better * values)
    return Toned(numeral(float(values[place])), "good") if is_best else numeral(float(values[place]))

"""Which state was known when, in words."""

from __future__ import annotations

import numpy as np

from obsdesign.report.number_format import numeral, signal_label, with_unit
from obsdesign.report.section import Section
from obsdesign.report.table import TableColumn, finite, tabulate
from obsdesign.study.log_study import LogStudy

_LOOSE = 2.0  # times the median bound, beyond which a state counts as loose
_LONG = 0.01  # of the log: shorter stretches are not told


def section(study: LogStudy) -> Section:
    """Return the answer to "Which state is bound when?"."""
    drive, states = study.replay, study.replay.question.system.model.states
    sentences = tuple(_sentence(study, i) for i in range(len(states)))
    rows = []
    for i, signal in enumerate(states):
        factor = signal.display_unit[0] if signal.is_angle else 1.0
        error = drive.error[:, i]
        rms = float(np.sqrt(np.nanmean(error**2))) if np.isfinite(error).any() else float("nan")
        numbers = float(np.median(drive.bound[:, i])), float(drive.bound[:, i].max()), rms
        rows.append((signal_label(signal), *(factor * value for value in numbers)))
    columns = (TableColumn("state"), *(TableColumn(head, finite) for head in ("bound, median", "bound, largest", "RMSE")))
    table = tabulate("Each state", "In the unit of the state; the bound: 1σ that no filter is below.", columns, rows)
    return Section("states", "Which state is bound when?", "", (), (table,), sentences)


def _sentence(study: LogStudy, i: int) -> str:
    drive = study.replay
    signal, bound, t = drive.question.system.model.states[i], drive.bound[:, i], drive.t - drive.t[0]
    median = float(np.median(bound))
    text = f"{signal.name} is bound to {with_unit(median, signal)} half of the time"
    loose = _longest(bound > _LOOSE * median, t)
    if loose is None:
        return f"{text}, and nowhere for long to more than {numeral(_LOOSE)} times that."
    first, last, end = loose
    worst = float(bound[(t >= first) & (t <= last)].max())
    when = "until the end" if end else f"until {last:.4g} s"
    return f"{text}; from {first:.4g} s {when} it is loose, up to {with_unit(worst, signal)}."


def _longest(is_loose: np.ndarray, t: np.ndarray) -> tuple[float, float, bool] | None:
    """Return first and last time of the longest stretch in which it holds, and whether that goes on to the end."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_loose.astype(int), [0]])))
    if not len(edges):
        return None
    spans = [(float(t[a]), float(t[min(b, len(t) - 1)]), b >= len(t)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    longest = max(spans, key=lambda span: span[1] - span[0])
    return longest if longest[1] - longest[0] > _LONG * (t[-1] - t[0]) else None

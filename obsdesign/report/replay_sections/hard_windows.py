"""Is it told beforehand? Predictions of windows against what happened."""

from __future__ import annotations

import numpy as np

from obsdesign.log_replay.rank_correlation import RankCorrelation
from obsdesign.report.number_format import numeral, with_unit
from obsdesign.report.replay_figures import window_scatter
from obsdesign.report.section import Section
from obsdesign.report.table import TableColumn, finite, tabulate
from obsdesign.study.log_study import LogStudy

_ALIKE = 1.1  # of the smallest prediction, up to which windows cannot be ranked
_WITHOUT_TRUTH = "Truth is needed only for the factor between errors and predictions. Which windows were hard is told without it."


def section(study: LogStudy) -> Section:
    """Return the answer to "Which stretches were hard?"."""
    drive = study.replay
    picture = window_scatter.picture(study)
    rows = [
        _row("posterior information", drive.rank_correlation),
        _row("the filter's own covariance", drive.rank_correlation_own),
        _row("samples of the window alone", drive.rank_correlation_plain),
    ]
    columns = (TableColumn("predicted by"), *(TableColumn(f"{head} [–]", finite) for head in ("rank correlation", "from", "to", "windows")))
    table = tabulate("Do predictions rank windows as errors do?", "Good: near 1. Interval: 95 %, by blocks of windows.", columns, rows)
    return Section(
        "windows", "Which stretches were hard?", _answer(study), () if picture is None else (picture,), (table,), (_WITHOUT_TRUTH,)
    )


def _answer(study: LogStudy) -> str:
    drive = study.replay
    hard = [window for window in drive.windows if np.isfinite(window.predicted)]
    if not hard:
        return "No window could be judged."
    signal = drive.question.signal
    worst = max(hard, key=lambda window: window.predicted)
    best = min(hard, key=lambda window: window.predicted)
    least, largest = with_unit(best.predicted, signal), with_unit(worst.predicted, signal)
    if worst.predicted < _ALIKE * best.predicted:
        factor = f"; errors are {numeral(drive.ratio)} times that (median)" if np.isfinite(drive.ratio) else ""
        return f"All stretches were alike: no filter is below {least} to {largest}{factor}."
    start = drive.t[0]
    told = (
        f"hardest from {worst.first - start:.4g} to {worst.last - start:.4g} s, where no filter is below {largest};"
        f" easiest from {best.first - start:.4g} to {best.last - start:.4g} s, {least}"
    )
    if not np.isfinite(drive.ratio):
        return f"It was {told}. There is no truth, so the factor to errors is not told."
    return f"It was {told}. Errors are {numeral(drive.ratio)} times what is predicted (median)."


def _row(name: str, correlation: RankCorrelation) -> tuple[str, float, float, float, float]:
    return name, correlation.value, correlation.low, correlation.high, float(correlation.windows)

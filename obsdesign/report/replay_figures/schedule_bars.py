"""What the filter errs by with fewer sensors."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from obsdesign.report.figures._drawing import BLUE, INK, QUIET, Picture, inline_svg, light_grid, styled_figure
from obsdesign.report.number_format import numeral
from obsdesign.study.log_study import LogStudy


def picture(study: LogStudy) -> Picture | None:
    """Return the bars of all on, chosen, round robin and random, None where no truth tells errors."""
    bars = {item.name: item.rmse for item in study.schedule_errors}
    if not bars:
        return None
    widest = max((value for value in bars.values() if np.isfinite(value)), default=1.0)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        light_grid(axes, "x")
        colours = [BLUE if name == "chosen" else QUIET for name in bars]
        axes.barh(list(bars), [value if np.isfinite(value) else widest for value in bars.values()], height=0.66, color=colours)
        for row, value in enumerate(bars.values()):
            text, tip = (numeral(value), value) if np.isfinite(value) else ("lost its way", widest)
            axes.annotate(text, (tip, row), xytext=(4, 0), textcoords="offset points", va="center", color=INK, fontsize=9)
        unit = study.replay.question.signal.unit or "–"
        axes.set(xlim=(0, 1.2 * widest), ylim=(len(bars) - 0.4, -0.6), xlabel=f"RMSE of the filter [{unit}]")
        axes.tick_params(axis="y", length=0)

    caption = (
        f"The filter on this log with the samples of {study.setup.choice.per_segment} of {len(study.replay.run.sensors)} sensors at a time:"
        " as chosen, in turns (the median of some beginnings), and by chance. Schedules are chosen by what the model predicts: one slip of"
        " the wheels that it does not know of, or other noise, moves these errors by a tenth, and smaller differences mean little."
    )
    return Picture(inline_svg(styled_figure(0.8 + 0.36 * len(bars), paint), "bars", "Errors with schedules"), caption)

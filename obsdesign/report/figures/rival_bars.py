"""The chosen schedule against what one would have done without thinking."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from obsdesign.report.derived_quantities import drawing_suffix, start_schedule_name, zero_round_off
from obsdesign.report.figures._drawing import BLUE, FAINT, INK, QUIET, Picture, inline_svg, light_grid, styled_figure
from obsdesign.report.number_format import NOTHING, numeral
from obsdesign.study.rated_schedules import FOR
from obsdesign.study.record import Study


def picture(study: Study) -> Picture:
    """Return the criterion of the chosen schedule, the naive ones and the random ones against the bound."""
    bars = rival_values(study)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        _draw_bars(study, figure.add_subplot(), bars)

    name, description = f"rivals{drawing_suffix(study)}", "Value of the chosen schedule, the naive ones and the bound"
    return Picture(inline_svg(styled_figure(0.95 + 0.36 * len(bars), paint), name, description), _caption(study))


def _caption(study: Study) -> str:
    """Say what the bars compare."""
    best = max([value for name, value in list(rival_values(study).items())[1:] if not name.endswith("*")], default=0.0)
    value, rules = study.selection.schedule.value, any(rival.breaks for rival in study.selection.rivals)
    starred = " Schedules with * break the rules." if rules else ""
    criterion = study.scenario.schedule_criterion
    if not criterion.is_smallest_eigenvalue:
        return f"What all samples say of the state at the start under each schedule, by {criterion.label}.{starred}"
    others = "the best of the others that keep the rules" if rules else "the best of the others"
    than = f"{numeral(value / best)} times as much as {others}" if best > 0 else "the others see nothing of one direction"
    return (
        f"What all samples say of the combination of states known least at the start, under each schedule: the one {FOR['start']} gives "
        f"{than}.{starred}"
    )


def rival_values(study: Study) -> dict[str, float]:
    """Return the criterion of each schedule, the chosen one first."""
    selection = study.selection
    random, count = selection.random_values, len(selection.random_values)
    naive = {f"{rival.name}{' *' if rival.breaks else ''}": zero_round_off(study, rival.value) for rival in selection.rivals}
    if not count:
        return {start_schedule_name(study): selection.schedule.value} | naive
    tail = {f"best of {count} random": float(random[-1]), "median random": float(np.median(random))}
    return {start_schedule_name(study): selection.schedule.value} | naive | tail


def _draw_bars(study: Study, axes: Axes, bars: dict[str, float]) -> None:
    bound, symbol = study.selection.schedule.bound, study.scenario.schedule_criterion.symbol
    keeps = " without *" if any(rival.breaks for rival in study.selection.rivals) else ""
    light_grid(axes, "x")
    finite = [value for value in (bound, *bars.values()) if np.isfinite(value)]
    low, widest = min(0.0, *finite), max(0.0, *finite)
    axes.barh(
        list(bars), [value if np.isfinite(value) else low for value in bars.values()], height=0.66, color=[BLUE, *[QUIET] * (len(bars) - 1)]
    )
    axes.axvline(bound, color=INK, linestyle=":", linewidth=1.2)
    for row, value in enumerate(bars.values()):
        inside = value > 0.3 * widest if low == 0 else value < 0.3 * low
        away = 1 if low == 0 else -1
        colour, side = ("white", "right" if low == 0 else "left") if inside else (INK, "left" if low == 0 else "right")
        shift = -4 * away if inside else 4 * away
        place = {"xytext": (shift, 0), "textcoords": "offset points", "ha": side, "va": "center"}
        text, tip = (numeral(value), value) if np.isfinite(value) else (NOTHING, 0.0)
        axes.annotate(text, (tip, row), color=colour, fontsize=9, **place)
    axes.set(xlim=(low * 1.02, widest * 1.02), ylim=(len(bars) - 0.4, -0.6), xlabel=f"{symbol} of S W S [–]")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_color(FAINT)
    axes.set_title(f"no schedule{keeps} lies beyond the dotted line, {numeral(bound)}", loc="right")

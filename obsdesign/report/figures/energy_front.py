"""Information against what is spent for it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from obsdesign.arguments import validate_arguments
from obsdesign.dynamics.path_segments import segments_along
from obsdesign.report.derived_quantities import drawing_suffix
from obsdesign.report.figures._drawing import BLUE, INK, VERMILLION, Picture, inline_svg, legend_below, light_grid, styled_figure
from obsdesign.report.number_format import numeral, percent
from obsdesign.rules.energy_budget import EnergyBudget
from obsdesign.selection.pareto import Pareto
from obsdesign.study.record import Study

_POINTS = 200  # of a line that is straight between few corners: more of them make sharper corners and a larger page


@validate_arguments
def front(pareto: Pareto) -> Figure:
    """Draw the best schedule found for each limit of a budget, and what no schedule that spends as little is above.

    Arguments:
        pareto: the front, as od.pareto returns it.
    """
    return draw_front(pareto, "value of the schedule [–]", None)


def picture(study: Study) -> Picture | None:
    """Return the front with the chosen schedule on it; None where no front was asked for."""
    pareto = study.selection.pareto
    if pareto is None:
        return None
    label = f"{study.scenario.schedule_criterion.symbol} of S W S [–]"
    figure = draw_front(pareto, label, (*_spending(study), study.selection.schedule.value))
    description = "Information against what is spent, with what no schedule exceeds"
    return Picture(inline_svg(figure, f"front{drawing_suffix(study)}", description), _caption(study, pareto))


def _caption(study: Study, pareto: Pareto) -> str:
    """Say what the front shows, and what half of the spending would buy."""
    value, top = study.selection.schedule.value, float(np.max(pareto.values))
    half = pareto.values[pareto.spent <= 0.5 * pareto.spent.max()]
    buys = len(half) and top > 0 and study.scenario.schedule_criterion.scales_with_information
    words = f" Half of the largest spending buys {percent(float(half.max()) / top)} of the most." if buys else ""
    return (
        f"Each dot is a schedule; no schedule that spends as little lies above the dashed line, which is certified.{words} The schedule "
        f"for the start, {numeral(value)}, is the ring."
    )


def draw_front(pareto: Pareto, label: str, chosen: tuple[float, float, float] | None) -> Figure:
    """Draw a front; chosen: what the chosen schedule spends, what it may spend, and its value; None = it is not marked."""

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        light_grid(axes)
        _draw_lines(axes, pareto)
        if chosen is not None:
            _draw_chosen(axes, *chosen)
        axes.set(xlabel="spent, at most [unit of the energy budget]", ylabel=label, xlim=(0, None))
        if float(np.min(pareto.values)) >= 0:
            axes.set_ylim(0, None)
        axes.yaxis.set_major_locator(MaxNLocator(6))
        legend_below(figure, axes)

    return styled_figure(3.6, paint)


def _draw_lines(axes: Axes, pareto: Pareto) -> None:
    limits = np.linspace(float(np.min(pareto.limits)), float(np.max(pareto.limits)), _POINTS)
    above = [pareto.above(float(limit)) for limit in limits]
    axes.plot(limits, above, color=INK, linestyle="--", linewidth=1.1, label="no schedule is above")
    order = np.argsort(pareto.spent)
    look = {"drawstyle": "steps-post", "marker": "o", "markersize": 5, "color": BLUE, "linewidth": 1, "label": "best schedule found"}
    axes.plot(pareto.spent[order], pareto.values[order], **look)


def _draw_chosen(axes: Axes, spent: float, limit: float, value: float) -> None:
    ring = {"linestyle": "none", "marker": "o", "markersize": 10, "markerfacecolor": "none", "markeredgewidth": 1.6}
    axes.plot(spent, value, color=VERMILLION, label="chosen", **ring)
    axes.axvline(limit, color=VERMILLION, linestyle=":", linewidth=1.2, label="limit of the scenario")


def _spending(study: Study) -> tuple[float, float]:
    """What the chosen schedule spends, and what it may spend."""
    budget = next(rule for rule in study.scenario.selection.rules if isinstance(rule, EnergyBudget))
    resource = budget.terms(segments_along(study.scenario.system.model, study.main.path, study.main.nodes)).resource
    chosen = study.selection.schedule.chosen
    if resource is None:
        return float("nan"), budget.limit
    before = np.vstack([np.zeros((1, chosen.shape[1]), dtype=bool), chosen[:-1]])
    return float(resource.usage[chosen].sum() + (resource.start * (chosen & ~before)).sum()), budget.limit

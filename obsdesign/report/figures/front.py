"""Information against what is spent for it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from obsdesign.dynamics.path_segments import segments_along
from obsdesign.report.derived_quantities import drawing_suffix
from obsdesign.report.figures._drawing import BLUE, INK, VERMILLION, inline_svg, legend_below, light_grid
from obsdesign.rules.energy_budget import EnergyBudget
from obsdesign.study.record import Study

_POINTS = 200  # of a line that is straight between few corners: more of them make sharper corners and a larger page


def front_figure(study: Study) -> str:
    """Draw the best schedule found for each limit of the energy budget and what none is above; "" where no front was asked for."""
    front = study.selection.pareto
    if front is None:
        return ""

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        light_grid(axes)
        limits = np.linspace(float(np.min(front.limits)), float(np.max(front.limits)), _POINTS)
        axes.plot(
            limits, [front.above(float(limit)) for limit in limits], color=INK, linestyle="--", linewidth=1.1, label="no schedule is above"
        )
        order = np.argsort(front.spent)
        look = {"drawstyle": "steps-post", "marker": "o", "markersize": 5, "color": BLUE, "linewidth": 1, "label": "best schedule found"}
        axes.plot(front.spent[order], front.values[order], **look)
        spent, limit = _spending(study)
        ring = {"linestyle": "none", "marker": "o", "markersize": 10, "markerfacecolor": "none", "markeredgewidth": 1.6}
        axes.plot(spent, study.selection.schedule.value, color=VERMILLION, label="chosen", **ring)
        axes.axvline(limit, color=VERMILLION, linestyle=":", linewidth=1.2, label="limit of the scenario")
        name = study.scenario.schedule_criterion.symbol
        axes.set(xlabel="spent, at most [unit of the energy budget]", ylabel=f"{name} of S W S [–]", xlim=(0, None))
        if float(np.min(front.values)) >= 0:
            axes.set_ylim(0, None)
        axes.yaxis.set_major_locator(MaxNLocator(6))
        legend_below(figure, axes)

    return inline_svg(f"front{drawing_suffix(study)}", "Information against what is spent, with what no schedule exceeds", 3.6, paint)


def _spending(study: Study) -> tuple[float, float]:
    """What the chosen schedule spends, and what it may spend."""
    budget = next(rule for rule in study.scenario.selection.rules if isinstance(rule, EnergyBudget))
    resource = budget.terms(segments_along(study.scenario.system.model, study.main.path, study.main.nodes)).resource
    chosen = study.selection.schedule.chosen
    if resource is None:
        return float("nan"), budget.limit
    before = np.vstack([np.zeros((1, chosen.shape[1]), dtype=bool), chosen[:-1]])
    return float(resource.usage[chosen].sum() + (resource.start * (chosen & ~before)).sum()), budget.limit

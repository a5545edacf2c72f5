"""What the filter believed on a flight, and what was true."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.planning.closed_loop import Flight
from obsdesign.report.derived_quantities import states_of
from obsdesign.report.figures._drawing import BLUE, INK, VERMILLION, inline_svg, light_grid
from obsdesign.report.number_format import display_unit, signal_label
from obsdesign.study.record import Study

_POSITION_STATES = ("x", "y")


def flight_estimates_figure(study: Study) -> str:
    """Draw estimate, 2 sigma and truth of every state but the position over time; "" without a flight or such a state."""
    flight = study.flight
    shown = [i for i, signal in enumerate(states_of(study)) if signal.name not in _POSITION_STATES]
    if flight is None or not shown:
        return ""

    def paint(figure: Figure) -> None:
        panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False).ravel()
        for axes, which in zip(panels, shown, strict=True):
            _draw(study, flight, axes, which)
        panels[-1].set_xlabel("time [s]")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)

    return inline_svg("flight-estimates", "Estimates of the filter over time with 2 sigma and the truth", 0.9 + 1.45 * len(shown), paint)


def _draw(study: Study, flight: Flight, axes: Axes, which: int) -> None:
    signal = states_of(study)[which]
    factor, _ = display_unit(signal)
    error = flight.mean[:, which] - flight.truth[:, which]
    if signal.is_angle:  # whole turns do not count, and a turning vehicle's would hide all else
        error, truth = (error + np.pi) % (2 * np.pi) - np.pi, np.zeros(len(error))
    else:
        truth = factor * flight.truth[:, which]
    mean, reach = truth + factor * error, 2 * factor * flight.std[:, which]
    light_grid(axes)
    axes.fill_between(flight.t, mean - reach, mean + reach, color=BLUE, alpha=0.15, linewidth=0, label="estimate ± 2σ", zorder=1)
    axes.plot(flight.t, mean, color=BLUE, linewidth=1.2, label="estimate", zorder=3)
    axes.plot(flight.t, truth, color=INK, linewidth=1.2, linestyle="--", label="truth", zorder=4)
    if flight.straight is not None:
        wide = flight.straight.std[:, which] * 2 * factor
        for side in (-1, 1):
            text = "truth ± 2σ, inputs mid-range" if side > 0 else "_"
            axes.plot(flight.t, truth + side * wide, color=VERMILLION, linewidth=0.8, linestyle=":", label=text, zorder=2)
    low, high = (mean - reach)[1:].min(), (mean + reach)[1:].max()
    axes.set(xlim=(flight.t[0], flight.t[-1]), ylim=(low - 0.05 * (high - low), high + 0.05 * (high - low)))
    axes.set_title(f"error of {signal_label(signal)}" if signal.is_angle else signal_label(signal))

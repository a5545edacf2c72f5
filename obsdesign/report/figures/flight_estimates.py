"""What the filter believed on a flight, and what was true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.arguments import validate_arguments
from obsdesign.planning.closed_loop import Flight
from obsdesign.report.derived_quantities import states_of
from obsdesign.report.figures._drawing import BLUE, INK, VERMILLION, Picture, inline_svg, light_grid, styled_figure
from obsdesign.report.number_format import display_unit, signal_label
from obsdesign.signals import Signal
from obsdesign.study.record import Study

_POSITION_STATES = ("x", "y")


@validate_arguments
def estimates(flight: Flight, states: Sequence[Signal] | None = None) -> Figure:
    """Draw estimate, 2 sigma and truth of every state over time.

    Arguments:
        flight: the flight, as fly returns it.
        states: names and units of the n states, such as vehicle.states; None = by number. Angles are drawn as errors, in degrees.
    """
    signals = [Signal(f"state {i}") for i in range(flight.truth.shape[1])] if states is None else states
    return draw_estimates(flight, dict(enumerate(signals)))


def picture(study: Study) -> Picture | None:
    """Return the estimates of every state but the position; None without a flight or such a state."""
    shown = {i: signal for i, signal in enumerate(states_of(study)) if signal.name not in _POSITION_STATES}
    if study.flight is None or not shown:
        return None
    caption = (
        "Good: the dashed truth within the shade, and the shade narrow. Red dots: how wide the shade would be, about the truth, with all "
        "inputs in the middle of their ranges."
    )
    description = "Estimates of the filter over time with 2 sigma and the truth"
    return Picture(inline_svg(draw_estimates(study.flight, shown), "flight-estimates", description), caption)


def draw_estimates(flight: Flight, shown: Mapping[int, Signal]) -> Figure:
    """Draw a panel for each state that is shown, by its place in the state vector."""

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False).ravel()
        for axes, (which, signal) in zip(panels, shown.items(), strict=True):
            _draw(flight, axes, which, signal)
        panels[-1].set_xlabel("time [s]")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)

    return styled_figure(0.9 + 1.45 * len(shown), paint)


def _draw(flight: Flight, axes: Axes, which: int, signal: Signal) -> None:
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

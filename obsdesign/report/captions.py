"""What each figure means, in one sentence or two, and what the numbers are called."""

from __future__ import annotations

import numpy as np

from obsdesign.report import derived_quantities as facts
from obsdesign.report.figures.clearance import clearances
from obsdesign.report.figures.path import SIGMAS, ellipse_factor
from obsdesign.report.names import gap_formula, path_in_words, schedule_criterion
from obsdesign.report.number_format import NARROW, numeral, plain, with_unit
from obsdesign.study.record import Study

MIN_COMPONENT = 0.15  # components of a direction smaller than this go without saying


def map_caption(study: Study) -> str:
    """Say what the map's colours and ellipses mean."""
    seconds, factor = plain(study.scenario.time.segment), ellipse_factor(study)
    size = f"enlarged {factor} times" if factor > 1 else "to scale"
    return (
        f"Dark is where most is learnt about what is known least: the colour is v′Wₖv / v′Wv, the share that a segment of "
        f"{seconds}{NARROW}s adds to what all sensors know in the weakest direction v of {path_in_words(study.about)}. Ellipses are "
        f"{plain(SIGMAS)}σ of the position by the posterior Cramér-Rao bound with the chosen schedule, {size}."
    )


def spectrum_caption(study: Study) -> str:
    """Say what the eigenvalues mean and how those that are 0 are drawn."""
    zero = any(facts.clean_eigenvalues(quality)[0] == 0 for candidate in study.candidates for quality in candidate.qualities)
    tail = " A hollow dot is 0 to double precision, drawn at the floor: a combination of states that stays hidden." if zero else ""
    return f"The large dot of each path is what is known of the combination of states that is known least: higher is better.{tail}"


def eigenvectors_caption(study: Study) -> str:
    """Say how the panels are read, and what the first column of the baseline hides."""
    quality = study.candidate(study.baseline).qualities[-1]
    parts = [study.scenario.state_names[i] for i in np.argsort(-np.abs(quality.weakest)) if abs(quality.weakest[i]) >= MIN_COMPONENT]
    suite = facts.sensors_in_words(study, quality.sensors)
    visibility = "hidden from" if facts.clean_eigenvalues(quality)[0] == 0 else "known least to"
    mixture = f"{parts[0]} alone" if len(parts) == 1 else f"{parts[0]} against {' and '.join(parts[1:])}"
    return (
        "Each column is a combination of scaled states, its squares adding up to 1, that is known as well as the number below it says. "
        f"On {path_in_words(study.baseline)}, {mixture} is what is {visibility} {suite}."
    )


def inputs_caption(study: Study) -> str:
    """Say what the input histories show."""
    if not study.designs:
        return "What is asked of the vehicle along each path."
    between = "between" if len(study.scenario.design.bounds) == 1 else "each between"
    return f"What is asked of the vehicle, {between} its dotted bounds; the straight path, inputs as near 0 as they allow, is left out."


def clearance_caption(study: Study) -> str:
    """Say what keeps a path clear of the circle."""
    return (
        "√(f² + (T ḟ)²) with f the distance from the circle through the beacons and T the constraint's time scale: 0 is moving along the "
        "circle, on which bearings to the three cannot tell how far along it one is; the dotted line is the least that is allowed. "
        f"On {path_in_words(study.baseline)} it is {_clearance_text(study)}."
    )


def _clearance_text(study: Study) -> str:
    low, ours = (min(values[0].min() for values in clearances(study, name)) for name in (study.baseline, study.about))
    low = 0.0 if low < 1e-9 else low
    return f"{numeral(low)}{NARROW}m at least, on the designed path {numeral(ours)}{NARROW}m"


def errors_caption(study: Study) -> str:
    """Say what lines and shade are."""
    runs = study.checks[0].validation.runs
    return (
        f"Solid: root mean square error of {runs} filter runs; dashed: the posterior Cramér-Rao bound, one standard deviation (1σ), "
        f"below which errors fall by chance only; shaded: up to 2σ of that bound on {path_in_words(study.about)} with the chosen schedule. "
        "Good: solid on dashed, and low."
    )


def consistency_caption(study: Study) -> str:
    """Say what the band is."""
    low, high = study.checks[0].validation.nees_interval
    n = len(study.scenario.state_names)
    return (
        f"A filter that knows how well it does stays in the grey band, {numeral(low)} to {numeral(high)} about {n}, at 95{NARROW}% of the "
        "instants; above it the filter is overconfident."
    )


def glossary(study: Study) -> tuple[tuple[str, str], ...]:
    """Return (term, meaning) of everything that the page counts."""
    scale = ", ".join(with_unit(study.scenario.prior[signal.name], signal) + f" {signal.name}" for signal in facts.states_of(study))
    return (
        (
            "dimension",
            "how many independent combinations of the states the measurements and their derivatives determine, at the start state.",
        ),
        ("W", "information about the start state: the sum over samples of Φ′C′R⁻¹CΦ, Φ the sensitivity of the state to the start state."),
        (
            "S W S, eigenvalues",
            f"W with each state counted in units of its prior standard deviation ({scale}), so eigenvalues have no unit.",
        ),
        (
            "λmin",
            "smallest eigenvalue of S W S: information about the combination of states known least; 1 is as much as the prior knows.",
        ),
        (
            "Cramér-Rao bound",
            "smallest standard deviation that an unbiased estimate can have: in the table of paths of the start state, without prior and "
            "process noise; for the filter of the state at that time, with both.",
        ),
        ("cap", "smallest eigenvalue of a block of S W S that no path changes; no path exceeds it."),
        (
            "bound and gap",
            f"{schedule_criterion(study)} of every schedule that keeps the rules is below the bound; {gap_formula(study)}.",
        ),
        ("RMSE", "root mean square error over the filter runs, each with its own process noise, measurement noise and first estimate."),
        (
            "NEES",
            "normalised estimation error squared, e′P⁻¹e, averaged over the runs: for an honest filter the number of states on average.",
        ),
        ("overconfident", "the filter's covariance P is smaller than its errors."),
    )

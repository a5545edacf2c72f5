"""What the numbers of the page mean."""

from __future__ import annotations

from obsdesign.report import derived_quantities as facts
from obsdesign.report.names import gap_formula, minimised_in_words, schedule_criterion
from obsdesign.report.number_format import with_unit
from obsdesign.study.record import Study


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
        (
            "cost to the filter",
            f"{minimised_in_words(study.scenario)}, each state in units of its prior standard deviation; smaller is better, and no "
            "schedule that keeps the rules is below its bound.",
        ),
        ("RMSE", "root mean square error over the filter runs, each with its own process noise, measurement noise and first estimate."),
        (
            "NEES",
            "normalised estimation error squared, e′P⁻¹e, averaged over the runs: for an honest filter the number of states on average.",
        ),
        ("overconfident", "the filter's covariance P is smaller than its errors."),
    )

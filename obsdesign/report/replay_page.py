"""A replayed log as one self-contained HTML page."""

from __future__ import annotations

import numpy as np

from obsdesign.report.number_format import numeral, with_unit
from obsdesign.report.page import environment
from obsdesign.report.question_to_document import versions
from obsdesign.report.replay_sections import drive, fewer_sensors, fit, hard_windows, sensors, states
from obsdesign.report.section import KeyNumber, Section
from obsdesign.study.log_study import LogStudy


def replay_page(study: LogStudy) -> str:
    """Return the page: HTML without any reference to the network; the same study gives the same text."""
    return (
        environment()
        .get_template("replay.html.j2")
        .render(
            title=study.setup.title,
            question="What does the log say?",
            answer=_answer(study),
            headline=_headline(study),
            parts=_sections(study),
            notes=study.notes,
            versions=versions(),
        )
    )


def _sections(study: LogStudy) -> tuple[Section, ...]:
    chosen = () if study.schedule is None else (fewer_sensors.section(study, study.schedule),)
    fitted = () if study.calibration is None else (fit.section(study, study.calibration),)
    return (drive.section(study), sensors.section(study), hard_windows.section(study), states.section(study), *chosen, *fitted)


def _answer(study: LogStudy) -> str:
    run, signal, about = study.replay, study.replay.question.signal, ", ".join(study.replay.question.about)
    if not np.isfinite(run.rmse):
        bound = with_unit(_bound(study, run.t >= run.t[0]), signal)
        return f"The best possible filter knows {about} to {bound} on average; how well this one did is not told without truth."
    is_half = np.isfinite(run.rmse_second_half)
    error = with_unit(run.rmse_second_half if is_half else run.rmse, signal)
    # of the instants at which the error is one: at the beginning all of it is the prior's
    is_later = run.t > (np.mean(run.question.log.span) if is_half else -np.inf)
    is_told = is_later & np.isfinite(run.error[:, run.question.places]).all(axis=1)
    where = " in the second half of the log" if is_half else ""
    bound = with_unit(_bound(study, is_told), signal)
    return f"The filter errs by {error} in {about}{where}; over many such drives no filter errs by less than {bound} there."


def _bound(study: LogStudy, is_counted: np.ndarray) -> float:
    """Root mean square over some instants (N+1,) of what no filter is below."""
    run = study.replay
    return float(np.sqrt(np.mean((run.bound[is_counted][:, run.question.places] ** 2).sum(axis=1))))


def _headline(study: LogStudy) -> tuple[KeyNumber, ...]:
    run = study.replay
    numbers = [KeyNumber("drive", f"{len(run.hidden_windows)} of {len(run.windows)}", "windows do not see all of the state")]
    if np.isfinite(run.rmse):
        numbers.insert(0, KeyNumber("drive", with_unit(run.rmse, study.replay.question.signal), f"RMSE of {', '.join(run.question.about)}"))
        numbers.append(
            KeyNumber("windows", numeral(run.rank_correlation.value), "rank correlation of predicted and actual errors of windows")
        )
        numbers.append(KeyNumber("windows", numeral(run.ratio), "times the prediction: the errors of windows"))
    numbers.append(KeyNumber("drive", f"{run.rejections}", "samples rejected by the gate"))
    return tuple(numbers)

"""Where? The drive, and how well it could be known."""

from __future__ import annotations

from obsdesign.report.number_format import percent
from obsdesign.report.replay_figures import drive_map, error_band
from obsdesign.report.section import Section
from obsdesign.study.log_study import LogStudy


def section(study: LogStudy) -> Section:
    """Return the answer to "Could it be seen?"."""
    drive = study.replay
    hidden, count = len(drive.hidden_windows), len(drive.windows)
    seen = "The samples of every window see all of the state" if not hidden else f"{hidden} of {count} windows do not see all of the state"
    rejected = drive.rejections / max(len(drive.question.log.samples.t), 1)
    answer = f"{seen}. The gate rejected {percent(rejected)} of the samples."
    pictures = tuple(picture for picture in (drive_map.picture(study), error_band.picture(study)) if picture is not None)
    words: dict[str, list[float]] = {}
    for window in drive.hidden_windows:
        words.setdefault(window.hidden, []).append(window.first - drive.t[0])
    notes = [f"{_times(times)}: {text}." for text, times in sorted(words.items(), key=lambda item: -len(item[1]))[:6]]
    locked = [
        f"Locked out of {stretch.sensor} from {stretch.first - drive.t[0]:.4g} to {stretch.last - drive.t[0]:.4g} s: the filter was wrong"
        for stretch in drive.locked_out[:6]
    ]
    return Section("drive", "Could it be seen?", answer, pictures, (), (*notes, *locked))


def _times(times: list[float]) -> str:
    first = f"from {times[0]:.4g} s on"
    return f"One window, {first}" if len(times) == 1 else f"{len(times)} windows, the first {first}"

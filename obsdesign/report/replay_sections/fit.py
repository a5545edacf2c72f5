"""What was calibrated, from what."""

from __future__ import annotations

from obsdesign.calibration.calibration_record import Calibration
from obsdesign.report.section import Section
from obsdesign.report.table import TableColumn, finite, tabulate
from obsdesign.study.log_study import LogStudy


def section(study: LogStudy, calibration: Calibration) -> Section:
    """Return the answer to "What do the data say of the noise?"."""
    told = [entry for entry in calibration.numbers if entry.is_told]
    share = 100 * study.setup.settings.calibrate
    answer = (
        f"The first {share:.3g} % of the log tell {len(told)} of {len(calibration.numbers)} numbers; the others are as they were stated."
    )
    rows = [(entry.name, f"{entry.unit or '–'}", entry.value, entry.low, entry.high, entry.source) for entry in told]
    columns = (
        TableColumn("number"),
        TableColumn("unit"),
        *(TableColumn(head, finite) for head in ("value", "from", "to")),
        TableColumn("told by"),
    )
    table = tabulate("Calibration", "Intervals: 95 %.", columns, rows)
    return Section("fit", "What do the data say of the noise?", answer, (), (table,), calibration.notes)

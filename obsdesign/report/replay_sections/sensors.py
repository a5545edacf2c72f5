"""Which sensor mattered when, and whether each is as good as it is taken for."""

from __future__ import annotations

from obsdesign.report.number_format import join, numeral, plain
from obsdesign.report.replay_figures import innovation_bars, sensor_raster
from obsdesign.report.replay_figures.innovation_bars import sensor_innovations
from obsdesign.report.section import Section
from obsdesign.report.table import TableColumn, finite, hundredths, tabulate
from obsdesign.study.log_study import LogStudy

_LITTLE = 0.02  # growth that does not matter


def section(study: LogStudy) -> Section:
    """Return the answer to "Which sensor mattered?"."""
    growths = study.growth
    best = max(growths, key=growths.__getitem__)
    idle = [name for name, growth in growths.items() if growth < 1 + _LITTLE]
    could = f"; {join(idle)} could have been left off" if idle and len(idle) < len(growths) else ""
    answer = f"Most hung on {best}: without it the error would have been {numeral(growths[best])} times as large{could}."
    run = study.replay.run
    arrived, rejected = run.arrived.sum(axis=0), run.rejected.sum(axis=0)
    rows = [
        (item.name, float(arrived[s]), rejected[s] / max(arrived[s], 1), growths[item.name], item.nis)
        for s, item in enumerate(sensor_innovations(study))
    ]
    columns = (
        TableColumn("sensor"),
        TableColumn("samples [–]", plain),
        TableColumn("rejected [%]", hundredths),
        TableColumn("error without it [times]", finite),
        TableColumn("NIS per output [–]", finite),
    )
    table = tabulate("Sensors", "Good: a NIS near 1, and few rejected.", columns, rows)
    return Section("sensors", "Which sensor mattered?", answer, (sensor_raster.picture(study), innovation_bars.picture(study)), (table,))

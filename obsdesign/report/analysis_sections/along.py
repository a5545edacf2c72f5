"""Where does the motion hide the state?"""

from __future__ import annotations

import numpy as np

from obsdesign.information.singular_motion import Singularities
from obsdesign.report.analysis_figures import nearness
from obsdesign.report.number_format import numeral, percent
from obsdesign.report.section import Section
from obsdesign.report.table import Table, TableColumn, tabulate
from obsdesign.study.analysis_along import AlongPath

_LARGE = 1e-6  # of a direction's largest entry, whatever its unit: less is rounding


def section(along: AlongPath) -> Section:
    """Return how near the motion comes to hiding the state, and on which stretches it does."""
    motion = along.motion
    tables = (_stretches_table(motion),) if motion.hidden else ()
    return Section("along", f"Where does {along.name} hide the state?", answer(motion), (nearness.picture(motion),), tables, along.notes)


def answer(motion: Singularities) -> str:
    """Say for which share of the time something is hidden, or when it is nearest to that."""
    n = len(motion.names)
    if not motion.hidden:
        weakest = int(motion.nearness.argmin())
        when, share = numeral(float(motion.t[weakest])), numeral(float(motion.nearness[weakest]))
        near = f"it is nearest to that at {when} s, where the smallest singular value is {share} of the largest"
        return f"Nowhere: outputs and their derivatives tell all {n} states all along; {near}."
    share = float(np.mean(motion.rank < n))
    return f"For {percent(share)} of the time, on {len(motion.hidden)} stretch{'es' * (len(motion.hidden) > 1)}."


def _stretches_table(motion: Singularities) -> Table:
    """When something is hidden, how many directions are seen, and what the others are made of."""
    rows = []
    for interval in motion.hidden:
        parts = [_direction(vector, motion.names) for vector in interval.null_space.T]
        rows.append(
            (f"{numeral(interval.start)} to {numeral(interval.end)} s", f"{interval.rank} of {len(motion.names)}", "; ".join(parts))
        )
    columns = (TableColumn("stretch"), TableColumn("seen"), TableColumn("hidden: what may change together"))
    return tabulate("Stretches that hide something", "Good would be none.", columns, rows)


def _direction(vector: np.ndarray, names: tuple[str, ...]) -> str:
    """A direction in words: its entries over the largest, small ones left out."""
    scaled = vector / vector[np.abs(vector).argmax()]
    return ", ".join(f"{numeral(float(value))} {name}" for name, value in zip(names, scaled, strict=True) if abs(value) > _LARGE)

"""Where a path, or what a filter made of a log, hides the state."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.estimation.log_run import estimate_log, path_of_estimate
from obsdesign.information.singular_motion import Singularities, singularities
from obsdesign.study.log_setup import LogSetup
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class AlongPath:
    """What the motion along a path hides; name: what the path is called; notes: what was made of its file."""

    name: str
    motion: Singularities
    notes: tuple[str, ...] = ()


def along_path(system: AbstractSystem, path: Trajectory, name: str, notes: tuple[str, ...] = ()) -> AlongPath:
    """Return what the motion along a path hides. Raises InputError as singularities."""
    return AlongPath(name, singularities(system, path), notes)


def along_log(setup: LogSetup) -> AlongPath:
    """Return what the motion of a log hides, along what a filter with the noises of the scenario makes of it."""
    psds = setup.disturbance_psd, setup.input_psd
    estimate = estimate_log(setup.system, setup.log, setup.prior, disturbance_psd=psds[0], input_psd=psds[1])
    path = path_of_estimate(setup.system, setup.log, estimate)
    note = "along what a filter makes of the log, sensors counting as if they answered all the time"
    return along_path(setup.system, path, setup.file.name, (note, *setup.notes))

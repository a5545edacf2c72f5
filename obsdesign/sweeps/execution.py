"""Running every combination: what is finished is kept, what failed is recorded, what is left goes on."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from itertools import islice
from logging import getLogger
from pathlib import Path
from typing import Any

from obsdesign.arguments import validate_arguments
from obsdesign.errors import InputError, ObsdesignError
from obsdesign.files import write_files
from obsdesign.progress import Progress, StageReport
from obsdesign.scenario.schema import Scenario
from obsdesign.sweeps.headline import headline
from obsdesign.sweeps.run_file import FOLDER, RunAnswer, Task, compute, read_answer, task_of, write_answer
from obsdesign.sweeps.sweep_record import Sweep, SweepRun
from obsdesign.sweeps.variation import Values, accepted_data, combinations_of

_LOGGER = getLogger(__name__)
_AHEAD = 256  # tasks that wait in the executor


class LostWorkersError(ObsdesignError):
    """The executor ended before the sweep did; what was finished is kept."""


@validate_arguments
def sweep(
    scenario: Scenario,
    vary: Mapping[str, Any],
    *,
    executor: Executor | None = None,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Run a scenario with every combination of values under some of its keys.

    Each run is one task and has one file, written when it is finished, and named by what was run: a sweep that was killed goes on where it
    ended when it is started again, and combinations that other sweeps into the same folder have run are not run again. A run that fails
    is recorded with its error. Every run has the seed of its scenario: the answer is the same for any number of workers.

    Arguments:
        scenario: what is run, as load_scenario returns it.
        vary: key -> values; a key is a path of names joined by dots, where a sensor stands under its name: {"sensors.gps.sigma": [1, 2]};
            "sensors" itself takes lists of the sensors that stay; "seed": range(100).
        executor: any concurrent.futures.Executor; each run gets one call, None = one after the other here.
        out: folder for the files; None = kept in memory alone.
        progress: is called with how far it is; None = nobody is told.
    Raises, before any run, InputError for a scenario that was not read from a file, a key that leads nowhere, two that lead to one place,
    values that the scenario does not accept, and a folder that cannot be written; LostWorkersError where the executor ends.
    """
    combinations = combinations_of(vary)
    tasks = _tasks_of(scenario, combinations)
    folder = None if out is None else Path(out)
    report = StageReport(_LOGGER, progress)
    answers = _answers_on_file(folder, tasks)
    missing = [task for name, task in {task.name: task for task in tasks}.items() if name not in answers]
    total = len(missing)
    report(f"{total} of {len(tasks)} runs to do" + (f", the others are in {folder}" if len(answers) else ""))
    if folder is not None and missing:
        write_files(folder / FOLDER, {})  # a folder that cannot be written is refused before any run
    for done, (task, answer, is_final) in enumerate(_compute_all(missing, executor), 1):
        if folder is not None and is_final:
            write_answer(folder, task.name, answer)
        answers[task.name] = _run_of(answer)
        report.within(f"{done} of {total} runs")
    runs = (SweepRun(task.name, dict(values), *answers[task.name]) for task, values in zip(tasks, combinations, strict=True))
    return Sweep(scenario.title, tuple(vary), tuple(runs), folder)


def _tasks_of(scenario: Scenario, combinations: Sequence[Values]) -> list[Task]:
    """Return the task of each combination. Raises InputError for the first that the scenario does not accept."""
    if not scenario.source:
        raise InputError("a sweep varies the keys of a scenario's file: load the scenario with load_scenario")
    return [task_of(accepted_data(scenario, values), scenario.file) for values in combinations]


def _answers_on_file(folder: Path | None, tasks: Sequence[Task]) -> dict[str, tuple[Mapping[str, Any], str]]:
    """Return numbers and errors of the runs that have their files."""
    if folder is None or not (folder / FOLDER).is_dir():
        return {}
    found = ((task.name, read_answer(folder, task)) for task in tasks)
    return {name: _run_of(answer) for name, answer in found if answer is not None}


def _run_of(answer: RunAnswer) -> tuple[Mapping[str, Any], str]:
    """Return the numbers of an answer, and its error."""
    data = answer.data
    return ({}, data["error"]) if data["result"] is None else (headline(data["result"]), "")


def _compute_all(tasks: Sequence[Task], executor: Executor | None) -> Iterator[tuple[Task, RunAnswer, bool]]:
    """Yield each task with its answer as it comes, and whether that is final: what a lost worker leaves is not."""
    if executor is None:
        yield from ((task, *_compute_here(task)) for task in tasks)
        return
    waiting = iter(tasks)
    pending: dict[Future[RunAnswer], Task] = {}
    try:
        while True:
            # a few at a time: memory stays bounded whatever the number of runs
            for task in islice(waiting, _AHEAD - len(pending)):
                pending[_call(executor, task)] = task
            if not pending:
                return
            finished, _ = wait(pending, return_when=FIRST_COMPLETED)
            for future in sorted(finished, key=_is_lost):  # what is finished is kept before the end of the executor is told
                yield pending.pop(future), *_answer_of(future)
    finally:
        for future in pending:
            future.cancel()


def _compute_here(task: Task) -> tuple[RunAnswer, bool]:
    """Return the answer of a task, or what the machine lacked for it, which is not kept."""
    try:
        return compute(task), True
    except (MemoryError, OSError) as error:
        return _lost(error), False


def _call(executor: Executor, task: Task) -> Future[RunAnswer]:
    """Return the call of a task, one that failed where the executor takes no more."""
    try:
        return executor.submit(compute, task)
    except RuntimeError as error:  # of which BrokenExecutor is one
        refused: Future[RunAnswer] = Future()
        refused.set_exception(BrokenExecutor(str(error)))
        return refused


def _is_lost(future: Future[RunAnswer]) -> bool:
    return not future.cancelled() and isinstance(future.exception(), BrokenExecutor)


def _answer_of(future: Future[RunAnswer]) -> tuple[RunAnswer, bool]:
    """Return what a call answered; an error of the executor is one of the run, which is not kept, unless the executor is at its end."""
    try:
        return future.result(), True
    except BrokenExecutor as error:
        raise LostWorkersError(f"the executor ended: {error}; finished runs are kept where they have files: start again to go on") from None
    except Exception as error:  # noqa: BLE001  # of somebody else's executor: a worker that was killed too often, say
        return _lost(error), False


def _lost(error: Exception) -> RunAnswer:
    """Return the answer of a run that no worker finished."""
    return RunAnswer(json.dumps({"error": f"{type(error).__name__}: {error}", "result": None}))

"""The base of all errors, those of every room, and what each means to a command."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

from obsdesign.status import Status


class ExitCode(IntEnum):
    """What the exit code of a command says."""

    DONE = 0
    NO = 1
    BAD_INPUT = 2
    SOLVER_FAILED = 3
    INTERRUPTED = 130


class ObsdesignError(Exception):
    """Base of all errors that obsdesign raises on purpose."""

    @property
    def exit_code(self) -> ExitCode:
        """What a command that meets it ends with."""
        return ExitCode.SOLVER_FAILED


class InputError(ObsdesignError, ValueError):
    """A value handed to the library is refused; the message names it, shows it and says what is accepted."""

    @property
    def exit_code(self) -> ExitCode:
        """Bad input."""
        return ExitCode.BAD_INPUT


class ScenarioError(ObsdesignError):
    """A scenario file cannot be used; the message names the key, the value and what is accepted.

    problems: the same for a machine, one mapping for each thing that is wrong: line (from 1, None where the file has none), key, value,
    message, accepted (names, empty where they cannot be listed), nearest (the accepted name that is nearly the one given, or None).
    """

    def __init__(self, message: str, problems: tuple[Mapping[str, object], ...] = ()) -> None:
        super().__init__(message)
        self.message = message
        self.problems = problems

    def __reduce__(self) -> tuple[type, tuple[str, tuple[Mapping[str, object], ...]]]:
        return type(self), (self.message, self.problems)

    @property
    def exit_code(self) -> ExitCode:
        """Bad input."""
        return ExitCode.BAD_INPUT


class SolveError(ObsdesignError):
    """A solver ended without an answer; `status` is its verdict in the common vocabulary."""

    def __init__(self, what: str, status: Status, reason: str = "") -> None:
        super().__init__(f"{what}: {status.value}" + (f": {reason}" if reason else ""))
        self.what = what
        self.status = status
        self.reason = reason

    def __reduce__(self) -> tuple[type, tuple[str, Status, str]]:
        return type(self), (self.what, self.status, self.reason)

    @property
    def exit_code(self) -> ExitCode:
        """The study says no where nothing is feasible; a failure otherwise."""
        return ExitCode.NO if self.status.is_infeasible else ExitCode.SOLVER_FAILED

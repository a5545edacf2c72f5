"""Every error a caller may want to catch: one base class, one name per cause."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from obsdesign.analysis.verdict import Verdict
    from obsdesign.status import Status


class ObsdesignError(Exception):
    """Base of all errors that obsdesign raises on purpose."""


class InputError(ObsdesignError, ValueError):
    """A value handed to the library is refused; the message names it, shows it and says what is accepted."""


class ScenarioError(ObsdesignError):
    """A scenario file cannot be used; the message names the key, the value and what is accepted."""


class UnobservableError(ObsdesignError):
    """The sensors cannot see the whole state; `verdict` says which direction stays hidden."""

    def __init__(self, verdict: Verdict) -> None:
        super().__init__(f"unobservable: the sensors see {verdict.dimension} of {verdict.null_space.shape[0]} dimensions; {verdict.hidden}")
        self.verdict = verdict

    def __reduce__(self) -> tuple[type, tuple[Verdict]]:
        return type(self), (self.verdict,)


class SolveError(ObsdesignError):
    """A solver ended without an answer; `status` is its verdict in the common vocabulary."""

    def __init__(self, what: str, status: Status, reason: str = "") -> None:
        super().__init__(f"{what}: {status.value}" + (f": {reason}" if reason else ""))
        self.what = what
        self.status = status
        self.reason = reason

    def __reduce__(self) -> tuple[type, tuple[str, Status, str]]:
        return type(self), (self.what, self.status, self.reason)

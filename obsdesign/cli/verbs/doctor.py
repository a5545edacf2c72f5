"""`obsdesign doctor`: what is installed, what runs, and whether it comes to a known truth."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass
from time import perf_counter

from obsdesign import __version__
from obsdesign.cli.verb import Outcome, Verb
from obsdesign.errors import ExitCode

# import name, name on the index, what it is for
_EXTRAS = (
    ("rosbags", "rosbags", "ros", "bags of ROS 2, to read and to write"),
    ("pyulog", "pyulog", "px4", "logs of PX4"),
    ("pymavlink", "pymavlink", "ardupilot", "logs of ArduPilot"),
    ("pandas", "pandas", "", "to_dataframe() of results"),
)


@dataclass(frozen=True)
class Check:
    """One thing that was looked at: whether it is well, and what was seen; `is_needed`: whether obsdesign does without."""

    what: str
    is_well: bool
    seen: str
    is_needed: bool = True


def doctor(_: Namespace) -> Outcome:
    """Look at versions, compiler, solvers and extras, and compute something whose answer is known."""
    import platform

    checks = [*_packages(), _compiler(), *_solvers(), *_extras(), _known_truth()]
    ill = [check for check in checks if check.is_needed and not check.is_well]
    width = max(len(check.what) for check in checks)
    marks = {(True, True): "ok", (True, False): "ok", (False, True): "BAD", (False, False): "--"}
    lines = [f"obsdesign {__version__}, Python {platform.python_version()}, {platform.platform()}"]
    lines += [f"  {marks[check.is_well, check.is_needed]:3}  {check.what:{width}}  {check.seen}" for check in checks]
    lines.append("all is well" if not ill else f"{len(ill)} of {len(checks)} need attention: {', '.join(check.what for check in ill)}")
    document = {
        "versions": {"obsdesign": __version__, "python": platform.python_version(), "platform": platform.platform()},
        "checks": [{"what": c.what, "ok": c.is_well, "needed": c.is_needed, "seen": c.seen} for c in checks],
        "ok": not ill,
    }
    return Outcome(document, tuple(lines), code=ExitCode.SOLVER_FAILED if ill else ExitCode.DONE)


def _packages() -> list[Check]:
    """Every package that obsdesign is declared to need, and whether its version is one that it takes."""
    from importlib.metadata import requires

    from packaging.requirements import Requirement

    needed = [Requirement(text) for text in requires("obsdesign") or ()]
    return [_package(each.name, str(each.specifier)) for each in needed if each.marker is None or each.marker.evaluate({"extra": ""})]


def _package(name: str, accepted: str) -> Check:
    from importlib.metadata import PackageNotFoundError, version

    from packaging.specifiers import SpecifierSet

    try:
        installed = version(name)
    except PackageNotFoundError:
        return Check(name, False, f"missing: pip install '{name}{accepted}'")
    fits = SpecifierSet(accepted).contains(installed, prereleases=True)
    return Check(name, fits, installed if fits else f"{installed}: must be {accepted}: pip install '{name}{accepted}'")


def _compiler() -> Check:
    from obsdesign.native_code import compiler

    machine = compiler()
    without = f"{machine.reason}: what runs long runs in CasADi's virtual machine, to the same numbers"
    return Check(
        "C compiler", bool(machine.path), f"{machine.path}: {machine.version.splitlines()[0]}" if machine.path else without, is_needed=False
    )


def _solvers() -> list[Check]:
    """min x, x >= 1 by each of the solvers that is used."""
    import cvxpy as cp

    checks = []
    for solver in ("CLARABEL", "HIGHS"):
        x = cp.Variable()
        try:
            value = cp.Problem(cp.Minimize(x), [x >= 1]).solve(solver=solver)
            checks.append(Check(f"solver {solver.title()}", abs(float(value) - 1) < 1e-6, f"min x, x >= 1: {float(value):.6g}"))  # pyright: ignore[reportArgumentType]
        except Exception as error:  # noqa: BLE001  # whatever a broken installation raises
            checks.append(Check(f"solver {solver.title()}", False, f"{type(error).__name__}: {error}"))
    return checks


def _extras() -> list[Check]:
    from importlib.metadata import version
    from importlib.util import find_spec

    checks = []
    for module, package, extra, purpose in _EXTRAS:
        there = find_spec(module) is not None
        command = f"obsdesign[{extra}]" if extra else package
        checks.append(
            Check(package, there, f"{version(package)}: {purpose}" if there else f"for {purpose}: pip install '{command}'", False)
        )
    return checks


def _known_truth() -> Check:
    """Brace and Morgansen, lemma 3: with GPS alone and no turning, heading and wind cannot be told apart: 4 of 5 dimensions.

    And the Gramian of x' = v, y = x + noise of sigma over N samples dt apart: sum [1, k dt]'[1, k dt] / sigma^2, in closed form.
    """
    import casadi as ca
    import numpy as np

    import obsdesign as od

    begin = perf_counter()
    glider = od.System(od.Dubins(speed=15.0, wind="constant"), (od.GPS(sigma=2.0),))
    straight = od.observability(glider, held={"turn_rate": 0.0}).dimension
    turning = od.observability(glider).dimension
    x, steps, dt, sigma = ca.SX.sym("x", 2), 20, 0.5, 3.0
    cart = od.ControlAffineSystem(
        state=x, names=("x", "v"), drift=ca.vertcat(x[1], 0), known={"u": ca.SX([0, 1])}, outputs={"x": x[0]}, sigmas={"x": sigma}
    )
    W = od.variational_gramian(cart, od.simulate(cart, [0.0, 1.0], np.zeros((steps, 1)), dt)).total
    k = np.arange(steps) * dt
    closed = np.array([[steps, k.sum()], [k.sum(), (k**2).sum()]]) / sigma**2
    error = float(np.abs(W / closed - 1).max())
    seconds = perf_counter() - begin
    seen = f"GPS sees {straight} of 5 dimensions straight on and {turning} turning (4, 5); Gramian off by {error:.0e}; {seconds:.1f} s"
    return Check("known truth", (straight, turning) == (4, 5) and error < 1e-9, seen)


VERB = Verb(
    name="doctor",
    what="say which versions, compiler, solvers and extras are there, and compute something whose answer is known",
    action=doctor,
    example="doctor",
    exits=(ExitCode.DONE, ExitCode.SOLVER_FAILED),
)

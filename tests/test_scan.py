"""The loop behind everything: against a plain Python loop, in machine code and in the virtual machine, with a compiler and without."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign import native_code as native
from obsdesign.dynamics import scan as loop
from obsdesign.dynamics.scan import Scan
from obsdesign.estimation.filter_bank import Belief, FilterBank

few = settings(deadline=None, max_examples=15, database=None, derandomize=True)
MODES = pytest.mark.parametrize("mode", ["0", "1"], ids=["virtual machine", "machine code"])
NEEDS_COMPILER = pytest.mark.skipif(not native.compiler().path, reason="no C compiler on this machine")


@pytest.fixture(scope="module", autouse=True)
def kept_apart(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The user's cache folder stays as it is."""
    folder = tmp_path_factory.mktemp("compiled")
    with mock.patch.object(native, "cache_folder", lambda: folder):
        yield


@pytest.fixture
def kept_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder."""
    folder = tmp_path / "cache" / "compiled"
    monkeypatch.setattr(native, "cache_folder", lambda: folder)
    return folder


# ---------------------------------------------------------------- a random law, and the loop in plain Python


@dataclass(frozen=True)
class Law:
    """carry+ = tanh(A carry + sum_i B_i row_i) with |A| < 1, result_j = sin(C_j carry + sum_i D_ji row_i), its first entry 0."""

    A: np.ndarray
    B: list[np.ndarray]
    C: list[np.ndarray]
    D: list[list[np.ndarray]]

    @property
    def widths(self) -> list[int]:
        return [matrix.shape[1] for matrix in self.B]

    def scan(self, mode: str) -> Scan:
        """The law as a scan; the first entry of each result is missing from the graph, not merely 0."""
        carry = ca.SX.sym("carry", len(self.A))
        rows = [ca.SX.sym(f"row_{i}", width) for i, width in enumerate(self.widths)]
        results = []
        for C, D in zip(self.C, self.D, strict=True):
            result = ca.SX(len(C), 1)
            if len(C) > 1:
                result[1:] = ca.sin(_sum(C, D, carry, rows))[1:]
            results.append(result)
        with mock.patch.dict(os.environ, {native.ENVIRONMENT_VARIABLE: mode}):
            return Scan(carry, rows, ca.tanh(_sum(self.A, self.B, carry, rows)), results)


def _sum(matrix: np.ndarray, others: list[np.ndarray], carry: ca.SX, rows: list[ca.SX]) -> ca.SX:
    pairs = [(matrix, carry), *zip(others, rows, strict=True)]
    return ca.SX.zeros(len(matrix)) + sum((ca.DM(M) @ value for M, value in pairs if M.size), ca.SX.zeros(len(matrix)))


def random_law(seed: int, carry: int, rows: list[int], results: list[int]) -> Law:
    random = np.random.default_rng(seed)
    A = random.standard_normal((carry, carry))
    A *= 0.8 / max(1.0, np.linalg.norm(A, 2)) if A.size else 1.0
    draw = random.standard_normal
    return Law(A, [draw((carry, a)) for a in rows], [draw((b, carry)) for b in results], [[draw((b, a)) for a in rows] for b in results])


def random_rows(seed: int, kinds: list[str], widths: list[int], paths: int, steps: int) -> list[np.ndarray]:
    shapes = {"held": (), "shared": (steps,), "own": (paths, steps)}
    random = np.random.default_rng(seed)
    return [random.standard_normal((*shapes[kind], width)) for kind, width in zip(kinds, widths, strict=True)]


def by_hand(law: Law, carry: np.ndarray, rows: list[np.ndarray], steps: int) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Two loops over paths and steps: carry (M, c), carries (M, N, c), results (M, N, b) each."""
    last, every = carry.copy(), np.empty((len(carry), steps, carry.shape[1]))
    results = [np.zeros((len(carry), steps, len(C))) for C in law.C]
    for m in range(len(carry)):
        for k in range(steps):
            now = [row if row.ndim == 1 else row[k] if row.ndim == 2 else row[m, k] for row in rows]
            for j, (C, D) in enumerate(zip(law.C, law.D, strict=True)):
                results[j][m, k, 1:] = np.sin(C @ last[m] + sum((M @ row for M, row in zip(D, now, strict=True)), np.zeros(len(C))))[1:]
            driven = sum((M @ row for M, row in zip(law.B, now, strict=True)), np.zeros(len(law.A)))
            last[m] = every[m, k] = np.tanh(law.A @ last[m] + driven)
    return last, every, results


def assert_is_the_loop(scan: Scan, law: Law, carry: np.ndarray, rows: list[np.ndarray], steps: int) -> None:
    """For every choice of what is wanted; the law is a contraction, so that rounding does not grow."""
    last, every, results = by_hand(law, carry, rows, steps)
    for carries, wanted in ((True, True), (False, True), (True, False), (False, False)):
        run = scan.run(carry, rows, steps, carries, wanted)
        np.testing.assert_allclose(run.carry, last, rtol=1e-12, atol=1e-13)
        assert run.carry.shape == last.shape
        if carries:
            np.testing.assert_allclose(run.carries, every, rtol=1e-12, atol=1e-13)
        assert run.carries.shape == (every.shape if carries else (len(carry), 0, carry.shape[1]))
        assert len(run.results) == (len(results) if wanted else 0)
        for found, expected in zip(run.results, results if wanted else [], strict=True):
            assert found.shape == expected.shape
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def backend_of(mode: str, ran: bool = True) -> str:
    if mode == "0":
        return "CasADi's virtual machine (switched off)"
    return "machine code" if ran else "CasADi's virtual machine (not run long enough)"


def compile_after(steps: int, monkeypatch: pytest.MonkeyPatch, load: int) -> None:
    """A function is compiled after so many steps, and looked for in the cache folder after `load`."""
    monkeypatch.setattr(loop, "_STEPS_BEFORE_LOAD", load)
    monkeypatch.setattr(loop, "_STEPS_BEFORE_COMPILE", steps)
    monkeypatch.setattr(loop, "_OPERATIONS_BEFORE_COMPILE", 0)


KIND = st.tuples(st.sampled_from(["held", "shared", "own"]), st.sampled_from([0, 1, 3]))


@NEEDS_COMPILER
@MODES
@few
@given(
    seed=st.integers(0, 10**6),
    carry=st.sampled_from([0, 1, 2, 5]),
    described=st.lists(KIND, max_size=3),
    results=st.lists(st.sampled_from([0, 1, 2, 4]), max_size=2),
    size=st.tuples(st.sampled_from([0, 1, 3]), st.sampled_from([0, 1, 5, 22])),
)
def test_a_scan_is_a_plain_loop(
    mode: str, seed: int, carry: int, described: list[tuple[str, int]], results: list[int], size: tuple[int, int]
):
    paths, steps = size
    kinds, widths = [kind for kind, _ in described], [width for _, width in described]
    law = random_law(seed, carry, widths, results)
    scan = law.scan(mode)
    start = np.random.default_rng(seed).standard_normal((paths, carry))
    assert_is_the_loop(scan, law, start, random_rows(seed + 1, kinds, widths, paths, steps), steps)
    assert scan.backend == backend_of(mode, ran=paths * steps > 0)


LAW = random_law(7, 3, [2, 1, 2], [3, 1])
KINDS = ["shared", "held", "own"]


@NEEDS_COMPILER
@MODES
@pytest.mark.parametrize("steps", [1, 5, 1023, 1024, 1500])
def test_a_long_run_is_cut_into_stretches_without_a_trace(mode: str, steps: int):
    rows = random_rows(steps, KINDS, LAW.widths, 2, steps)
    assert_is_the_loop(LAW.scan(mode), LAW, np.random.default_rng(1).standard_normal((2, 3)), rows, steps)


@NEEDS_COMPILER
@MODES
@pytest.mark.parametrize("entries", [100, 1 << 18], ids=lambda count: f"stretches of {count} numbers")
def test_a_scan_that_has_run_many_lengths_is_a_plain_loop_for_the_next(mode: str, entries: int, monkeypatch: pytest.MonkeyPatch):
    """More lengths than are kept exactly, and results too wide for long stretches."""
    monkeypatch.setattr(loop, "_MAX_ENTRIES", entries)
    scan = LAW.scan(mode)
    for steps in (*range(1, 12), 40, 3, 77, 10):
        assert_is_the_loop(
            scan, LAW, np.random.default_rng(1).standard_normal((2, 3)), random_rows(steps, KINDS, LAW.widths, 2, steps), steps
        )


@NEEDS_COMPILER
@MODES
@pytest.mark.parametrize("index", [[0, 1, 2], [2, 2, 0, 1, 0], [1], []], ids=str)
def test_a_result_spread_over_more_entries_repeats_them(mode: str, index: list[int], monkeypatch: pytest.MonkeyPatch):
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    column, following = ca.vertcat(ca.sin(x[0]) * u, 0), 0.5 * ca.cos(x + u)
    with mock.patch.dict(os.environ, {native.ENVIRONMENT_VARIABLE: mode}):
        spread, plain = (
            Scan(x, [u], following, [x - u, result]) for result in (loop.ExpandedColumn(column, np.array(index, dtype=int)), column)
        )
    start, u_rows = np.ones((3, 2)), random_rows(2, ["own"], [2], 3, 37)
    found, expected = spread.run(start, u_rows, 37), plain.run(start, u_rows, 37)
    assert spread.widths == (2, len(index))
    np.testing.assert_array_equal(found.results[0], expected.results[0])
    np.testing.assert_array_equal(found.results[1], expected.results[1][..., index])
    np.testing.assert_array_equal(found.carries, expected.carries)
    assert (expected.results[1][..., 2] == 0).all()
    np.testing.assert_allclose(found.results[0][0, 0], start[0] - u_rows[0][0, 0], rtol=1e-15)


@NEEDS_COMPILER
@MODES
def test_paths_walked_together_are_paths_walked_alone(mode: str):
    scan, steps = LAW.scan(mode), 37
    carry, rows = np.random.default_rng(2).standard_normal((3, 3)), random_rows(3, KINDS, LAW.widths, 3, steps)
    together = scan.run(carry, rows, steps)
    for m in range(3):
        own = [row[m] if row.ndim == 3 else row for row in rows]
        carries, *results = scan.along(carry[m], own[0], np.tile(own[1], (steps, 1)), own[2])
        np.testing.assert_array_equal(together.carries[m], carries)
        np.testing.assert_array_equal(together.carry[m], scan.last(carry[m], *own))
        for j, result in enumerate(results):
            np.testing.assert_array_equal(together.results[j][m], result)


@NEEDS_COMPILER
@MODES
def test_a_run_changes_neither_what_it_was_given_nor_what_it_gave_before(mode: str):
    scan, steps = LAW.scan(mode), 40
    carry, rows = np.random.default_rng(4).standard_normal((2, 3)), random_rows(5, KINDS, LAW.widths, 2, steps)
    before = [values.copy() for values in (carry, *rows)]
    first = scan.run(carry, rows, steps)
    kept = [values.copy() for values in (first.carry, first.carries, *first.results)]
    for carries, results in ((True, False), (False, True), (False, False), (True, True)):
        scan.run(carry + 1, [row - 1 for row in rows], steps, carries, results)
    for now, then in zip((carry, *rows, first.carry, first.carries, *first.results), (*before, *kept), strict=True):
        np.testing.assert_array_equal(now, then)


@NEEDS_COMPILER
@MODES
def test_arrays_may_lie_in_memory_as_they_like(mode: str):
    """Backwards, by columns, every second row, read-only, of whole numbers."""
    scan, steps = LAW.scan(mode), 21
    carry = np.array([[1, 0, -1]])
    shared, held, own = random_rows(6, KINDS, LAW.widths, 1, 2 * steps)
    shared.setflags(write=False)
    laid = [shared[::-2], np.array([3]), np.asfortranarray(own)[:, ::2]]
    plain = [np.array(values, dtype=float, order="C") for values in laid]
    found, expected = scan.run(carry, laid, steps), scan.run(carry.astype(float), plain, steps)
    np.testing.assert_array_equal(found.carries, expected.carries)
    np.testing.assert_array_equal(found.results[0], expected.results[0])
    np.testing.assert_allclose(expected.carry, by_hand(LAW, carry.astype(float), plain, steps)[0], rtol=1e-12)
    assert held.shape == (1,)


@NEEDS_COMPILER
@pytest.mark.parametrize("mode", ["0", "1", ""], ids=["virtual machine", "machine code", "compiled in between"])
def test_several_threads_may_run_one_scan(mode: str, monkeypatch: pytest.MonkeyPatch):
    compile_after(2_000, monkeypatch, load=200)
    law = random_law(11, 4, [2, 1, 2], [3, 1])
    scan = law.scan(mode)

    def task(seed: int) -> tuple[np.ndarray, ...]:
        steps, paths = 1 + 61 * seed % 200, 1 + seed % 3
        rows = random_rows(seed, KINDS, law.widths, paths, steps)
        run = scan.run(np.random.default_rng(seed).standard_normal((paths, 4)), rows, steps, seed % 2 == 0)
        return run.carry, run.carries, *run.results

    with ThreadPoolExecutor(8) as threads:
        at_once = list(threads.map(task, range(60)))
    for seed, found in enumerate(at_once):
        for one, other in zip(found, task(seed), strict=True):
            np.testing.assert_array_equal(one, other)
    rows = random_rows(5, KINDS, law.widths, 3, 106)
    expected = by_hand(law, np.random.default_rng(5).standard_normal((3, 4)), rows, 106)
    np.testing.assert_allclose(at_once[5][0], expected[0], rtol=1e-12, atol=1e-13)
    assert scan.backend == ("machine code" if mode != "0" else backend_of("0"))


# ---------------------------------------------------------------- machine code and the virtual machine: the same bits


def same_bits(one: np.ndarray, other: np.ndarray) -> bool:
    return one.shape == other.shape and one.tobytes() == other.tobytes()


@NEEDS_COMPILER
@pytest.mark.parametrize("length", ["short", "long"])
def test_every_operation_gives_the_same_bits_in_machine_code(length: str, monkeypatch: pytest.MonkeyPatch):
    """Also where products and sums could be fused, sine and cosine taken at once, and compilers told to do less."""
    if length == "long":
        monkeypatch.setattr(native, "LONG_SOURCE", 1)
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y", 2)
    a, b, c, d = x[0], x[1], y[0], y[1]
    results = ca.vertcat(
        *(a * b + c * d, a / c - b * d, ca.sin(a) * ca.cos(a), ca.tan(a), ca.exp(a * d) - 1, ca.log(a * a + 1e-3), ca.sqrt(a * a + b * b)),
        *((a * a + c * c) ** 0.5, (a * a + 0.1) ** -1.7, a**3, ca.atan2(c, d), ca.remainder(a + 9 * c, 2 * np.pi), ca.fmod(a, 0.3)),
        *(ca.fmax(a, d), ca.fmin(b, c), ca.fabs(c), ca.sign(b), ca.floor(10 * a), ca.if_else(a > d, a / b, b / a), ca.tanh(a), ca.erf(b)),
        *(ca.sinh(a), ca.cosh(b), ca.asin(ca.tanh(c)), ca.acos(ca.tanh(d)), ca.atan(a * d), 1 / (1 + ca.exp(-20 * a))),
    )
    carry_next = ca.vertcat(ca.sin(3 * a + b * c) + 0.4 * d, ca.cos(a * b - d) * ca.sqrt(1 + c * c))
    found = []
    for mode in ("0", "1"):
        with mock.patch.dict(os.environ, {native.ENVIRONMENT_VARIABLE: mode}):
            scan = Scan(x, [y], carry_next, [results])
        found.append(scan.run(np.array([[0.3, -0.7]]), [np.random.default_rng(0).standard_normal((3_000, 2))], 3_000))
        assert scan.backend == backend_of(mode)
    assert np.isfinite(found[0].results[0]).all()
    assert np.abs(found[0].carries[0, -1]).min() > 0
    assert same_bits(found[0].carries, found[1].carries)
    assert same_bits(found[0].results[0], found[1].results[0])


BEACON = (40.0, 25.0)
VEHICLES = {
    f"{name}, wind {wind}": make(wind)
    for name, make in (("dubins", lambda wind: od.Dubins(15.0, wind=wind)), ("unicycle", od.Unicycle))
    for wind in (None, "constant", "unknown")
}
QUICK = "unicycle, wind unknown"  # of which every scan is made


def sensors(mark: str) -> tuple[od.GPS | od.Magnetometer | od.Range | od.Bearing, ...]:
    """Every kind with every field; the names tell two systems apart that are otherwise the same."""
    return (
        od.GPS(2.0, rate=1.0, correlation=0.4, bias_floor=0.5, name=f"gps{mark}"),
        od.Magnetometer(0.2, inflation=1.3, name=f"magnetometer{mark}"),
        od.Range(BEACON, 1.0, sigma_per_metre=0.02, max_range=60.0, name=f"range{mark}"),
        od.Bearing(BEACON, 0.1, field_of_view=4.0, name=f"bearing{mark}"),
    )


def everything(system: od.System) -> dict[str, np.ndarray]:
    """What all scans of a system give."""
    random = np.random.default_rng(5)
    model = system.model
    n, steps = len(model.states), 24
    u = random.uniform(-0.6, 0.6, (steps, len(model.inputs))) + ([9.0, 0.0] if len(model.inputs) == 2 else 0.0)
    w = random.uniform(-2.0, 2.0, (steps, len(model.unknown_inputs)))
    path = od.simulate(system, np.array([3.0, -1.0, 0.4, 2.0, -1.0])[:n], u, 0.25, w)
    prior = od.Prior(path.x[0], std=np.array([5.0, 4.0, 0.3, 1.0, 1.5])[:n])
    psd = np.array([0.1, 0.2, 0.01, 0.05, 0.05])[:n]
    unknown = tuple(signal.name for signal in model.unknown_inputs)
    gramian = od.variational_gramian(system, path)
    value, gradient = od.information_gradient(system, path.x[0], u, 0.25, od.LogDet())
    means = path.x[0] + random.standard_normal((2, n))
    y, active = random.standard_normal((steps, 2, len(model.outputs))), random.random((steps, len(model.outputs))) < 0.7
    estimator = FilterBank(system, 0.25, 0.01 * np.eye(n))
    belief = estimator.run(Belief(means, np.tile(prior.covariance, (2, 1, 1))), u, y, active)
    one = estimator.update(estimator.predict(Belief(means, np.tile(prior.covariance, (2, 1, 1))), u[0]), y[0], active[0])
    check = od.validate(system, path, prior=prior, runs=3, disturbance_psd=psd)
    found = {
        "states": path.x,
        "gramian": gramian.blocks,
        "transition": gramian.transition,
        "empirical": od.empirical_gramian(system, path).blocks,
        "posterior": od.posterior_information(system, path, prior, psd, unknown),
        "segments": od.segment_information(system, path, 3),
        "windows": od.sliding_information(system, path, 5),
        "batch": od.batch_information(system, path.x[:3], u, 0.25, w),
        "value": np.array(value),
        "gradient": gradient,
        "means": belief.mean,
        "covariances": belief.covariance,
        "mean": one.mean,
        "covariance": one.covariance,
        "rmse": check.rmse,
        "nees": check.nees,
        "bound": check.bound,
    }
    if unknown:
        found["unknown inputs"] = od.unknown_input_information(system, path, prior, psd, unknown)
    return found


@NEEDS_COMPILER
@pytest.mark.parametrize("name", [name if name == QUICK else pytest.param(name, marks=pytest.mark.slow) for name in VEHICLES])
def test_everything_about_a_ready_made_system_has_the_same_bits_in_machine_code(name: str, monkeypatch: pytest.MonkeyPatch):
    made: list[Scan] = []
    begin = Scan.__init__

    def recorded(scan: Scan, *arguments: object, **named: object) -> None:
        begin(scan, *arguments, **named)
        made.append(scan)

    monkeypatch.setattr(Scan, "__init__", recorded)
    found, used = [], []
    for mode, mark in (("0", " of this"), ("1", " of that")):
        monkeypatch.setenv(native.ENVIRONMENT_VARIABLE, mode)
        made.clear()
        found.append(everything(od.System(VEHICLES[name], sensors(mark))))
        used.append({scan.backend for scan in made})
        assert len(made) >= 10
    assert used == [{backend_of("0")}, {"machine code"}]
    for what, values in found[0].items():
        assert np.isfinite(values).all()
        assert same_bits(np.ascontiguousarray(values), np.ascontiguousarray(found[1][what])), what


# ---------------------------------------------------------------- when functions are compiled

STEPS = 40


def ran(scan: Scan, runs: int = 1) -> np.ndarray:
    """The same run some times; the last one's carries."""
    rows = random_rows(8, KINDS, LAW.widths, 1, STEPS)
    return [scan.run(np.ones((1, 3)), rows, STEPS).carries for _ in range(runs)][-1]


TRUTH = by_hand(LAW, np.ones((1, 3)), random_rows(8, KINDS, LAW.widths, 1, STEPS), STEPS)[1]


def assert_right(scan: Scan) -> None:
    np.testing.assert_allclose(ran(scan), TRUTH, rtol=1e-12, atol=1e-13)


@NEEDS_COMPILER
def test_a_function_is_compiled_once_it_has_run_long_enough_and_loaded_sooner_where_it_is_kept(
    kept_in: Path, monkeypatch: pytest.MonkeyPatch
):
    compile_after(6 * STEPS, monkeypatch, load=3 * STEPS)
    scan, bits = LAW.scan(""), set()
    for run in range(1, 9):
        bits.add(ran(scan).tobytes())
        assert scan.backend == backend_of("1", ran=run >= 6)
        assert len(list(kept_in.glob("*.so"))) == (run >= 6)
    again = LAW.scan("")
    for run in range(1, 5):
        bits.add(ran(again).tobytes())
        assert again.backend == backend_of("1", ran=run >= 3)
    assert len(bits) == 1


@NEEDS_COMPILER
def test_zero_switches_compiling_off_and_one_compiles_at_once(kept_in: Path, monkeypatch: pytest.MonkeyPatch):
    compile_after(1, monkeypatch, load=1)
    never = LAW.scan("0")
    assert_right(never)
    assert never.backend == backend_of("0")
    assert not kept_in.exists()
    at_once = LAW.scan("1")
    assert_right(at_once)
    assert at_once.backend == "machine code"
    assert len(list(kept_in.glob("*.so"))) == 1
    assert same_bits(ran(never), ran(at_once))


@pytest.mark.parametrize(("value", "expected"), [("0", "never"), ("1", "at once"), ("", "when worth it"), ("yes", "when worth it")])
def test_the_environment_says_when_to_compile(value: str, expected: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(native.ENVIRONMENT_VARIABLE, value)
    assert native.compile_policy() == expected


@NEEDS_COMPILER
def test_a_scan_keeps_to_what_the_environment_said_when_it_was_built(monkeypatch: pytest.MonkeyPatch):
    scans = {mode: LAW.scan(mode) for mode in ("0", "1")}
    for mode, other in (("0", "1"), ("1", "0")):
        monkeypatch.setenv(native.ENVIRONMENT_VARIABLE, other)
        assert_right(scans[mode])
        assert scans[mode].backend == backend_of(mode)


def test_a_function_too_long_for_a_compiler_stays_in_the_virtual_machine(monkeypatch: pytest.MonkeyPatch, kept_in: Path):
    scan = LAW.scan("1")
    monkeypatch.setattr(native, "MAX_OPERATIONS", scan.instructions - 1)
    assert_right(scan)
    assert scan.backend == (
        f"CasADi's virtual machine ({scan.instructions} operations are too many for a compiler (at most {scan.instructions - 1}))"
    )
    assert not kept_in.exists()


# ---------------------------------------------------------------- the cache folder

ANSWER = "int answer_scan(void) { return %d; }\n"


def answered(number: int, operations: int = 1) -> native.NativeFunction:
    found = native.load(ANSWER % number, "answer_scan", operations)
    assert found is not None
    return found


def kept_files(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()}


@NEEDS_COMPILER
def test_a_file_is_kept_for_each_source_set_of_flags_processor_and_compiler(kept_in: Path, monkeypatch: pytest.MonkeyPatch):
    tool = native.compiler()
    assert answered(1).entry is not None
    first = kept_files(kept_in)
    assert answered(1).reason == ""
    assert kept_files(kept_in) == first
    changes: list[tuple[str, object]] = [
        ("FLAGS", (*native.FLAGS, "-g0")),
        ("processor", lambda: "another processor"),
        ("compiler", lambda: native.Compiler(tool.path, f"{tool.version} and a bit")),
    ]
    assert answered(2).entry is not None
    assert len(kept_files(kept_in)) == 2
    for count, (what, value) in enumerate(changes, start=3):
        with monkeypatch.context() as changed:
            changed.setattr(native, what, value)
            assert answered(1).entry is not None
            assert len(kept_files(kept_in)) == count
            assert answered(1).entry is not None
            assert len(kept_files(kept_in)) == count
    link = kept_in.parent / "compiler by another name"
    link.symlink_to(tool.path)
    monkeypatch.setattr(native, "compiler", lambda: native.Compiler(str(link), tool.version))
    assert answered(1).entry is not None
    assert len(kept_files(kept_in)) == 6
    assert answered(1, operations=native.LONG_SOURCE).entry is not None  # less optimised
    assert len(kept_files(kept_in)) == 7


@NEEDS_COMPILER
def test_what_is_only_asked_for_is_not_compiled(kept_in: Path):
    assert native.load(ANSWER % 5, "answer_scan", 1, only_cached=True) is None
    assert not kept_in.exists()
    assert answered(5).entry is not None
    kept = native.load(ANSWER % 5, "answer_scan", 1, only_cached=True)
    assert kept is not None
    assert kept.entry is not None


@NEEDS_COMPILER
def test_the_longest_unused_files_go_first(kept_in: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(native, "_MAX_FILES", 3)
    names = []
    for number in range(3):
        before = kept_files(kept_in) if kept_in.exists() else set()
        answered(number)
        (name,) = kept_files(kept_in) - before
        names.append(name)
        long_ago = time.time() - 1000 + number
        os.utime(kept_in / name, (long_ago, long_ago))
    answered(0)  # used: now the youngest
    answered(3)
    assert len(kept_files(kept_in)) == 3
    assert names[1] not in kept_files(kept_in)
    assert {names[0], names[2]} < kept_files(kept_in)


SPOILED = {
    "empty": b"",
    "no code": b"this is not machine code\n" * 100,
    "cut short": b"\x7fELF\x02\x01\x01" + bytes(20),
}


@NEEDS_COMPILER
@pytest.mark.parametrize("content", SPOILED.values(), ids=SPOILED.keys())
def test_a_spoiled_file_is_thrown_away_and_made_anew(kept_in: Path, content: bytes):
    """The file is replaced, not written into, as the loader of this process may still have it mapped."""
    law = random_law(len(content), 3, [1], [2])  # a file of its own: a library that is loaded already would be found by its name
    rows, start = random_rows(1, ["shared"], [1], 1, 9), np.ones((1, 3))
    expected = by_hand(law, start, rows, 9)[0]
    healthy = law.scan("1")
    with mock.patch.object(native.ctypes, "CDLL", side_effect=OSError("not now")):
        healthy.run(start, rows, 9)
    assert healthy.backend == "CasADi's virtual machine (compiling failed: not now)"
    assert not kept_files(kept_in)
    with mock.patch.object(native, "_open_library", side_effect=OSError("not yet")):  # made, but never opened
        law.scan("1").run(start, rows, 9)
    (name,) = kept_files(kept_in)
    (kept_in / name).unlink()
    (kept_in / name).write_bytes(content)
    scan = law.scan("1")
    np.testing.assert_allclose(scan.run(start, rows, 9).carry, expected, rtol=1e-12)
    assert scan.backend.startswith("CasADi's virtual machine (compiling failed: ")
    assert not kept_files(kept_in)
    anew = law.scan("1")
    np.testing.assert_allclose(anew.run(start, rows, 9).carry, expected, rtol=1e-12)
    assert anew.backend == "machine code"
    assert kept_files(kept_in) == {name}


@NEEDS_COMPILER
def test_a_file_without_the_function_is_thrown_away(kept_in: Path):
    answered(1)
    (file,) = kept_in.iterdir()
    other = native.load(ANSWER.replace("answer", "other") % 2, "other_scan", 1)
    assert other is not None
    (kept,) = set(kept_in.iterdir()) - {file}
    key = kept.name
    kept.unlink()
    shutil.copy(file, kept_in / "elsewhere")
    (kept_in / "elsewhere").replace(kept_in / key)
    found = native.load(ANSWER.replace("answer", "other") % 2, "other_scan_that_is_missing", 1)
    assert found is not None
    assert found.entry is None
    assert not (kept_in / key).exists()


AT_ONCE = """
import sys, time
from pathlib import Path
import numpy as np, casadi as ca
from obsdesign import native_code
from obsdesign.dynamics.scan import Scan
folder, go, me = map(Path, sys.argv[1:])
native_code.cache_folder = lambda: folder
x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 4)
following = x
for _ in range(40):
    following = ca.sin(following + u) * ca.cos(following[::-1])
scan = Scan(x, [u], following, [ca.sqrt(1 + following * following)])
me.touch()
while not go.exists():
    time.sleep(0.001)
run = scan.run(np.ones((1, 4)), [np.linspace(0, 1, 400).reshape(100, 4)], 100)
print(scan.backend, run.carry.tobytes().hex(), run.results[0].tobytes().hex())
"""


@NEEDS_COMPILER
def test_two_processes_that_compile_the_same_function_at_once_leave_one_file_that_was_never_seen_half_made(tmp_path: Path):
    folder, go, ready = tmp_path / "compiled", tmp_path / "go", [tmp_path / "first", tmp_path / "second"]
    environment = os.environ | {native.ENVIRONMENT_VARIABLE: "1"}
    processes = [
        subprocess.Popen([sys.executable, "-c", AT_ONCE, folder, go, me], env=environment, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
        for me in ready
    ]
    while not all(me.exists() for me in ready) and all(process.poll() is None for process in processes):
        time.sleep(0.01)
    go.touch()
    seen = set()
    while any(process.poll() is None for process in processes):
        seen.update(file.read_bytes() for file in folder.glob("*.so"))
        time.sleep(0.001)
    said = [process.communicate(timeout=120)[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    assert said[0] == said[1]
    assert said[0].startswith("machine code ")
    (kept,) = folder.iterdir()
    assert kept.suffix == ".so"
    assert seen <= {kept.read_bytes()}


# ---------------------------------------------------------------- without a compiler, or without a place for what it makes


@pytest.fixture
def other_compiler(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    """The compiler is looked for anew, before and after."""
    native.compiler.cache_clear()
    yield monkeypatch
    monkeypatch.undo()
    native.compiler.cache_clear()


def script(folder: Path, *lines: str) -> str:
    """A compiler that answers when asked for its version, and otherwise does what the lines say."""
    file = folder / "my_cc"
    file.write_text("\n".join(["#!/bin/sh", '[ "$1" = --version ] && echo my_cc 1.0 && exit 0', *lines, ""]))
    file.chmod(0o755)
    return str(file)


def assert_falls_back(reason: str) -> None:
    scan = LAW.scan("1")
    assert_right(scan)
    assert reason in scan.backend
    assert scan.backend.startswith("CasADi's virtual machine (")
    assert same_bits(ran(scan), ran(LAW.scan("0")))
    system = od.System(od.Unicycle(), (od.GPS(1.0, name=f"gps {reason}"),))  # a name of its own: not compiled before
    with mock.patch.dict(os.environ, {native.ENVIRONMENT_VARIABLE: "1"}):
        path = od.simulate(system, (0.0, 0.0, 0.0), np.tile([2.0, 0.0], (5, 1)), 0.5)
    np.testing.assert_allclose(path.x[-1], [5.0, 0.0, 0.0], atol=1e-14)


def test_without_a_compiler_the_virtual_machine_does_it(other_compiler: pytest.MonkeyPatch, kept_in: Path):
    other_compiler.setenv("PATH", "")
    other_compiler.delenv("CC", raising=False)
    assert_falls_back("no C compiler (cc, gcc, clang) is on the path")
    assert not kept_in.exists()


def test_a_compiler_that_was_asked_for_and_is_not_there_is_named(other_compiler: pytest.MonkeyPatch, kept_in: Path):
    other_compiler.setenv("CC", "no_such_cc")
    assert_falls_back("no C compiler (no_such_cc) is on the path")
    assert not kept_in.exists()


def test_a_compiler_that_does_not_run_is_none(other_compiler: pytest.MonkeyPatch, kept_in: Path):
    other_compiler.setenv("CC", "false")
    assert_falls_back("false does not run")
    assert not kept_in.exists()


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        (("echo my_cc: no room >&2", "exit 1"), "compiling failed: my_cc: no room"),
        (("exit 3",), "compiling failed: "),
        (("exit 0",), "compiling failed: "),  # says that all is well, and leaves nothing
        (("printf '\\377\\376 kaputt' >&2", "exit 1"), "compiling failed: "),  # bytes that are no text
        (("echo working on it >&2", "exec sleep 30"), "compiling failed: "),
    ],
    ids=["says why", "says nothing", "makes nothing", "says what is no text", "never ends"],
)
def test_a_compiler_that_fails_is_no_harm(
    other_compiler: pytest.MonkeyPatch, kept_in: Path, tmp_path: Path, lines: tuple[str, ...], reason: str
):
    other_compiler.setenv("CC", script(tmp_path, *lines))
    other_compiler.setattr(native, "_TIMEOUT", 0.3 if "sleep" in lines[-1] else 20.0)
    assert_falls_back(reason)
    assert not kept_files(kept_in)


@NEEDS_COMPILER
def test_a_cache_folder_that_cannot_be_made_is_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A file stands where the folder should be."""
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setattr(native, "cache_folder", lambda: tmp_path / "file" / "compiled")
    assert_falls_back("compiling failed: ")


@NEEDS_COMPILER
def test_a_cache_folder_whose_files_must_not_be_run_is_no_harm(kept_in: Path, monkeypatch: pytest.MonkeyPatch):
    """As the loader has it on a disk that is mounted so."""
    refused = OSError("failed to map segment from shared object")
    monkeypatch.setattr(native.ctypes, "CDLL", mock.Mock(side_effect=refused))
    assert_falls_back("compiling failed: failed to map segment from shared object")
    assert not kept_files(kept_in)


@pytest.mark.skipif(sys.platform != "linux", reason="where XDG_CACHE_HOME means something")
def test_compiled_functions_are_kept_in_the_cache_folder_of_the_user(tmp_path: Path):
    command = "from obsdesign import native_code; print(native_code.cache_folder())"
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    said = subprocess.run([sys.executable, "-c", command], env=environment, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert Path(said.strip()) == tmp_path / "obsdesign" / "compiled"


@pytest.mark.parametrize("carried", [0, 1])
@pytest.mark.parametrize("width", [1, 3])
def test_a_result_that_is_zero_for_every_row_is_written_all_the_same(carried: int, width: int):
    """CasADi leaves such results of a repeated function out; the buffer would keep what was there before."""
    carry, row = ca.SX.sym("carry", carried), ca.SX.sym("row", 2)
    scan = Scan(carry, [row], carry, [ca.SX.zeros(width), ca.vertcat(row[0], 0)])
    run = scan.run(np.ones((1, carried)), [np.full((5, 2), 7.0)], 5)
    np.testing.assert_array_equal(run.results[0], np.zeros((1, 5, width)))
    np.testing.assert_array_equal(run.results[1][0], np.tile([7.0, 0.0], (5, 1)))

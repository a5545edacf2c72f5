"""Sensor schedules: time to a proof, gaps, memory, growth, and others side by side."""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from subprocess import run
from time import perf_counter

import cvxpy as cp
import numpy as np
from scipy import optimize, sparse

import obsdesign as od
from benchmarks.tables import exponent, machine, table, write

BEACON = (40.0, 25.0)
UNITS = np.array([20.0, 20.0, 0.3, 3.0, 3.0])
SEEDS = (0, 1, 2)
PROVEN = 1e-9


def path_blocks(segments: int, samples: int, seed: int, step: float = 0.1) -> np.ndarray:
    """Dubins in a constant wind, wandering near a beacon: GPS, compass, range and bearing (K, 4, 5, 5), in the prior's units."""
    sensors = (od.GPS(2.0), od.Magnetometer(0.21), od.Range(BEACON, 1.0), od.Bearing(BEACON, 0.087))
    system = od.System(od.Dubins(15.0, wind="constant"), sensors)
    t, random = step * np.arange(segments * samples), np.random.default_rng(seed)
    rates, phases = random.uniform(0.05, 2.0, 6), random.uniform(0, 2 * np.pi, 6)
    turn_rate = 0.5 + 0.25 * np.sin(np.outer(t, rates) + phases).sum(axis=1)  # circles that drift and swell
    path = od.simulate(system, (3.0, -1.0, 0.4, 2.0, -1.0), turn_rate, step)
    return od.variational_gramian(system, path).by_segment(segments) * np.outer(UNITS, UNITS)


def random_blocks(segments: int, sensors: int, n: int, rank: int, seed: int) -> np.ndarray:
    """W = F F' of normal factors F (n, rank)."""
    factors = np.random.default_rng(seed).standard_normal((segments, sensors, n, rank))
    return factors @ factors.swapaxes(2, 3)


def main() -> None:
    """Write benchmarks/selection.md."""
    od.select_sensors(path_blocks(10, 4, 9))  # warm
    parts = [
        "# Sensor schedules: proofs, gaps, memory and growth",
        "",
        machine(),
        f"Seconds of one call on blocks that are there; median and worst of {len(SEEDS)} instances where two numbers stand.",
        "Gap: (bound - value) / bound. After every call its bound is compared with every schedule known of the same instance.",
        "",
        *_section("A proof", proofs()),
        *_section("Long paths", long_paths()),
        *_section("A hundred thousand segments", hundred_thousand()),
        *_section("Random blocks", random_instances()),
        *_section("Rules", ruled()),
        *_section("Others side by side", side_by_side()),
        *_section("Growth", growth()),
    ]
    write("selection", "\n".join(parts))


def _section(title: str, lines: list[str]) -> list[str]:
    return [f"## {title}", "", *lines, ""]


class Honest:
    """One instance: whatever is found for it is held against every bound for it, ever."""

    def __init__(self, blocks: np.ndarray, per_segment: int = 1, rules: Sequence[object] = ()) -> None:
        self.blocks, self.per_segment, self.rules = blocks, per_segment, tuple(rules)
        self.values: list[float] = []
        self.bounds: list[float] = []

    def solved(self, **options: object) -> tuple[float, od.Schedule]:
        """Seconds, and the schedule; its value is computed again."""
        began = perf_counter()
        found = od.select_sensors(self.blocks, self.per_segment, rules=self.rules, **options)  # pyright: ignore[reportArgumentType]
        seconds = perf_counter() - began
        if not self.rules:
            again = float(np.linalg.eigvalsh(np.einsum("ks,ksij->ij", found.chosen.astype(float), self.blocks))[0])
            if abs(again - found.value) > 1e-9 * abs(again) or found.chosen.sum(axis=1).max() > self.per_segment:
                raise AssertionError(f"a value of {found.value} is {again}, or too many sensors are on")
        self.know(found.value, found.bound)
        return seconds, found

    def know(self, value: float, bound: float = np.inf) -> None:
        """Take a value and a bound from wherever, and compare them all."""
        self.values.append(value)
        self.bounds.append(bound)
        if max(self.values) > min(self.bounds) * (1 + 1e-9):
            raise AssertionError(f"a bound of {min(self.bounds)} is below a schedule of {max(self.values)}")

    def random(self, count: int, seed: int = 0) -> None:
        """Know schedules drawn at random, as many sensors in each segment as there may be."""
        draw = np.random.default_rng(seed)
        K, S = self.blocks.shape[:2]
        for _ in range(count):
            order = draw.permuted(np.tile(np.arange(S), (K, 1)), axis=1)
            self.know(float(np.linalg.eigvalsh(self.blocks[order < self.per_segment].sum(axis=0))[0]))


def _spread(values: Sequence[float]) -> str:
    return f"{np.median(values):.2g}, {max(values):.2g}"


def _judged(reached: bool) -> str:
    return "yes" if reached else "NO"


# ---------------------------------------------------------------- parts


def proofs() -> list[str]:
    """Paths short enough for a proof."""
    rows = []
    for K, most in ((20, 5.0), (50, 30.0), (100, 30.0), (200, 30.0)):
        seconds, gaps, early, nodes = [], [], [], []
        for seed in SEEDS:
            each = Honest(path_blocks(K, 8, seed))
            each.random(50)
            spent, found = each.solved(time_limit=most)
            if K > 20:
                early.append(found.gap if spent <= 5 else each.solved(time_limit=5.0)[1].gap)
            seconds.append(spent)
            gaps.append(found.gap)
            nodes.append(found.nodes)
        proven = sum(gap <= PROVEN for gap in gaps)
        reached = _judged(proven == len(SEEDS) and max(seconds) <= most)
        rows.append(
            (
                K,
                _spread(seconds),
                f"{proven} of {len(SEEDS)}",
                _spread(gaps),
                _spread(early) if early else "",
                int(np.median(nodes)),
                reached,
            )
        )
    header = ("K", "s", "proven", "gap", "gap after 5 s", "partial schedules", "bar reached")
    return [
        "One of 4 sensors, n = 5, 8 samples to a segment. Bars: K = 20 proven under 5 s, the others under 30 s.",
        "",
        table(header, rows),
    ]


def long_paths() -> list[str]:
    """A thousand segments."""
    problems = [Honest(path_blocks(1000, 4, seed)) for seed in SEEDS]
    rows = []
    for what, options, most, bar in (
        ("gap of 5e-5 asked for", {"gap": 5e-5}, 1.0, 5e-5),
        ("all that 30 s give", {"time_limit": 30.0}, 30.5, 1e-5),
    ):
        found = [each.solved(**options) for each in (problems if most < 2 else problems[:2])]
        seconds, gaps = [each[0] for each in found], [each[1].gap for each in found]
        rows.append((what, _spread(seconds), _spread(gaps), _judged(max(seconds) <= most and max(gaps) <= bar)))
    text = "K = 1,000, 4 samples to a segment. Bars: 5e-5 under 1 s, 1e-5 under 30 s."
    return [text, "", table(("", "s", "gap", "bar reached"), rows)]


def hundred_thousand() -> list[str]:
    """In a process of its own, for its memory."""
    code = (
        "import json, time, numpy as np, obsdesign as od\n"
        "from benchmarks.selection import path_blocks\n"
        "from benchmarks.tables import peak_memory\n"
        "od.select_sensors(path_blocks(10, 4, 9))\n"
        "blocks = np.concatenate([path_blocks(10_000, 1, seed) for seed in range(10)]); before = peak_memory()\n"
        "began = time.perf_counter(); found = od.select_sensors(blocks, gap=1e-6); spent = time.perf_counter() - began\n"
        "print(json.dumps([spent, found.gap, before, peak_memory(), blocks.nbytes / 2**20]))\n"
    )
    done = run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    seconds, gap, before, after, size = json.loads(done.stdout.splitlines()[-1])
    rows = [
        ("s", f"{seconds:.2f}"),
        ("gap", f"{gap:.1e}"),
        ("peak memory, MB", f"{after:.0f}"),
        ("of that the blocks, MB", f"{size:.0f}"),
        ("peak memory before the call, MB", f"{before:.0f}"),
        ("bars reached", _judged(seconds <= 5 and gap <= 1e-6 and after <= 1024)),
    ]
    text = "K = 100,000: ten paths of 10,000 steps, a gap of 1e-6 asked for. Bars: under 5 s, at most 1e-6, under 1 GB."
    return [text, "", table(("", ""), rows)]


def random_instances() -> list[str]:
    """Where nothing is smooth along a path."""
    cases = (
        ("K = 1,000, n = 15, 4 of 32 sensors, rank 2", (1000, 32, 15, 2), 4, 10.0, 1e-3),
        ("K = 50, n = 5, 1 of 4 sensors, rank 1", (50, 4, 5, 1), 1, 30.0, 1.3e-2),
    )
    rows = []
    for name, shape, per_segment, most, bar in cases:
        seconds, gaps = [], []
        for seed in SEEDS if shape[0] < 1000 else SEEDS[:2]:
            each = Honest(random_blocks(*shape, seed), per_segment)
            each.random(20)
            spent, found = each.solved(gap=0.9 * bar, time_limit=most)
            seconds.append(spent)
            gaps.append(found.gap)
        rows.append(
            (name, _spread(seconds), _spread(gaps), f"{bar:g} in {most:g} s", _judged(max(seconds) <= 1.05 * most and max(gaps) <= bar))
        )
    return ["The gap of the bar asked for.", "", table(("", "s", "gap", "bar", "reached"), rows)]


def ruled() -> list[str]:
    """A thousand segments whose schedule is not free."""
    blocks = path_blocks(1000, 4, 0)
    free = Honest(blocks)
    _, best = free.solved(gap=1e-4)
    budget, switching = od.EnergyBudget(1200.0, {0: 2.0, 1: 0.2, 2: 1.0, 3: 1.0}), od.SwitchingCost(2e-4 * best.value)
    cases = {
        "an energy budget": (budget,),
        "a cost of switching": (switching,),
        "both": (budget, switching),
        "both, at least 5 segments on": (budget, switching, od.MinimumDwell(5)),
    }
    rows = []
    for name, rules in cases.items():
        each = Honest(blocks, 1, rules)
        seconds, found = each.solved(gap=1e-3, time_limit=10.0)
        if found.value > best.bound:
            raise AssertionError(f"{name}: a schedule that keeps rules is above the bound of those that do not")
        switches = int((np.diff(found.chosen.astype(int), axis=0, prepend=0) > 0).sum())
        rows.append((name, seconds, found.value / best.value, switches, f"{found.gap:.1e}", _judged(seconds <= 10 and found.gap <= 1e-3)))
    text = "K = 1,000, a gap of 1e-3 asked for. Bar: 1e-3 under 10 s."
    return [text, "", table(("", "s", "value, 1 without rules", "times switched on", "gap", "bar reached"), rows)]


def side_by_side() -> list[str]:
    """The same instances for all."""
    rows = []
    for name, blocks in (
        ("path, K = 8, S = 2", path_blocks(8, 8, 0)[:, [0, 2]]),
        ("path, K = 20", path_blocks(20, 8, 0)),
        ("path, K = 1,000", path_blocks(1000, 4, 0)),
        ("rank 1, K = 50", random_blocks(50, 4, 5, 1, 0)),
    ):
        instance = Honest(blocks)
        seconds, found = instance.solved(gap=1e-9 if len(blocks) <= 100 else 5e-5, time_limit=15.0)
        others = list(rivals(blocks, 15.0))
        rows.append((name, "obsdesign", f"{found.value:.8g}", f"{found.bound:.8g}", f"{seconds:.2f}", ""))
        for rival in others:
            instance.know(rival.value if np.isfinite(rival.value) else -np.inf)
            rows.append((name, rival.name, _number(rival.value), _number(rival.bound), f"{rival.seconds:.2f}", _said(rival, found)))
    text = (
        "obsdesign asks for a proof, for 5e-5 at K = 1,000; everybody has 15 s. HiGHS gets the cuts v'(sum s W)v >= t of every schedule\n"
        "that it finds, and its bound is its own. Last column: what a value is short of ours, and a bound that is below a schedule."
    )
    return [text, "", table(("", "", "value", "bound", "s", ""), rows)]


def _number(value: float) -> str:
    return f"{value:.8g}" if np.isfinite(value) else ""


def _said(rival: Rival, ours: od.Schedule) -> str:
    parts = [rival.said] if rival.said else []
    if np.isfinite(rival.value):
        parts.append(f"{1 - rival.value / ours.value:.1e} short")
    if rival.bound < ours.value * (1 - 1e-9):
        parts.append("BOUND BELOW A SCHEDULE")
    return ", ".join(parts)


def growth() -> list[str]:
    """More and more segments of the same kind."""
    rows, gaps, asked = [], [], 1e-4
    blocks = np.concatenate([path_blocks(10_000, 1, seed) for seed in range(10)])
    for K in (1000, 3000, 10_000, 30_000, 100_000):
        part = blocks[np.linspace(0, len(blocks) - 1, K).astype(int)]
        found = [Honest(part).solved(gap=asked, time_limit=60.0) for _ in range(3)]
        rows.append((K, float(np.median([each[0] for each in found])), f"{found[0][1].gap:.1e}"))
        gaps.append(found[0][1].gap)
    whole, late = (exponent([row[0] for row in part], [row[1] for row in part]) for part in (rows, rows[1:]))
    missed = sum(gap > asked for gap in gaps)
    reached = _judged(max(whole, late) <= 1.1 and not missed)
    text = f"Seconds grow as K^{whole:.2f}, from K = 3,000 on as K^{late:.2f}: bar reached: {reached}."
    if missed:
        text += f" {missed} of {len(gaps)} miss the gap asked for, so that their seconds are not those of the same work."
    return [
        f"K segments taken evenly from ten paths, a gap of {asked:g} asked for. Bar: an exponent of at most 1.1, the gap reached.",
        "",
        table(("K", "s", "gap"), rows),
        "",
        text,
    ]


# ---------------------------------------------------------------- other ways to a schedule of one sensor per segment


@dataclass(frozen=True)
class Rival:
    """What another method found; nan where it has no schedule or no bound."""

    name: str
    value: float
    bound: float
    seconds: float
    said: str = ""


def rivals(blocks: np.ndarray, time_limit: float) -> Iterator[Rival]:
    """Ask all that make sense for blocks (K, S, n, n)."""
    K, S = blocks.shape[:2]
    for method in (_greedy, _relaxed_and_rounded):
        yield method(blocks)
    if K * S <= 1000:
        yield _cuts(blocks, time_limit)
    if K * S <= 16:
        yield _all(blocks)


def _value(blocks: np.ndarray, picks: np.ndarray) -> float:
    return float(np.linalg.eigvalsh(blocks[np.arange(len(blocks)), picks].sum(axis=0))[0])


def _greedy(blocks: np.ndarray) -> Rival:
    """Segment after segment the sensor with the largest lambda_min so far; of equals, the largest trace."""
    began = perf_counter()
    W, picks = np.zeros(blocks.shape[2:]), np.zeros(len(blocks), dtype=int)
    for k, row in enumerate(blocks):
        lowest = np.linalg.eigvalsh(W + row)[:, 0]
        trace = np.trace(row, axis1=1, axis2=2)
        picks[k] = np.lexsort((trace, np.round(lowest, 12)))[-1]
        W = W + row[picks[k]]
    return Rival("greedy", _value(blocks, picks), np.nan, perf_counter() - began)


def _relaxed_and_rounded(blocks: np.ndarray) -> Rival:
    """The relaxation as it stands, in CVXPY by Clarabel; its value taken for a bound, its largest shares for a schedule."""
    began = perf_counter()
    K, S, n, _ = blocks.shape
    shares = cp.Variable((K, S), nonneg=True)
    W = cp.reshape(blocks.reshape(K * S, n * n).T @ cp.vec(shares, order="C"), (n, n), order="C")
    problem = cp.Problem(cp.Maximize(cp.lambda_min((W + W.T) / 2)), [cp.sum(shares, axis=1) <= 1])
    name = "CVXPY and Clarabel, rounded"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            problem.solve(solver=cp.CLARABEL)
    except cp.SolverError:
        return Rival(name, np.nan, np.nan, perf_counter() - began, "solver error")
    if shares.value is None:
        return Rival(name, np.nan, np.nan, perf_counter() - began, str(problem.status))
    picks = np.asarray(shares.value).argmax(axis=1)
    said = "" if problem.status == cp.OPTIMAL else str(problem.status)
    return Rival(name, _value(blocks, picks), float(problem.value), perf_counter() - began, said)  # pyright: ignore[reportArgumentType]


def _cuts(blocks: np.ndarray, time_limit: float) -> Rival:
    """max t over t <= sum_ks s_ks v'W_ks v, sum_s s_ks <= 1, s whole: solve, cut by the eigenvectors of what is found, again."""
    began = perf_counter()
    K, S, n, _ = blocks.shape
    directions = list(np.eye(n))
    few = sparse.hstack([sparse.kron(sparse.eye(K), np.ones((1, S))), sparse.csr_matrix((K, 1))])
    goal, whole = np.append(np.zeros(K * S), -1.0), np.append(np.ones(K * S), 0)
    upper = np.append(np.ones(K * S), np.inf)
    best, bound, rounds = -np.inf, np.inf, 0
    while best < bound * (1 - 1e-9) and perf_counter() - began < time_limit:
        V = np.array(directions)
        worth = np.einsum("vi,ksij,vj->vks", V, blocks, V).reshape(len(V), K * S)
        cuts = np.column_stack([-worth, np.ones(len(V))])
        limits = optimize.LinearConstraint(sparse.vstack([few, cuts]).tocsc(), -np.inf, np.append(np.ones(K), np.zeros(len(V))))
        options = {"time_limit": max(0.1, time_limit - (perf_counter() - began)), "mip_rel_gap": 1e-9}
        found = optimize.milp(goal, integrality=whole, bounds=optimize.Bounds(0, upper), constraints=limits, options=options)
        rounds += 1
        if found.mip_dual_bound is not None:
            bound = min(bound, -float(found.mip_dual_bound))
        if found.x is None:
            break
        W = np.tensordot(np.round(found.x[:-1]).reshape(K, S), blocks, 2)
        values, vectors = np.linalg.eigh(W)
        best = max(best, float(values[0]))
        directions += list(vectors.T)
    return Rival("HiGHS with eigenvector cuts", best, bound, perf_counter() - began, f"{rounds} rounds")


def _all(blocks: np.ndarray) -> Rival:
    began = perf_counter()
    picks = np.array(list(product(range(blocks.shape[1]), repeat=len(blocks))))
    W = sum(row[picks[:, k]] for k, row in enumerate(blocks))
    best = float(np.linalg.eigvalsh(W)[:, 0].max())
    return Rival("trying all", best, best, perf_counter() - began, f"{len(picks)} schedules")

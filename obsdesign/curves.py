"""Shortest curves of bounded curvature: between poses, through points, and to a goal in steady wind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from obsdesign.checks import as_array, as_pair, require_positive
from obsdesign.errors import InputError

Pose = tuple[float, float, float] | Sequence[float] | np.ndarray  # (x, y, heading) [m, m, rad]
PoseOrPoint = Pose | tuple[float, float]  # a pose, or a point (x, y) [m] whose heading is free

WORDS = ("LSL", "LSR", "LRL", "RSR", "RSL", "RLR")
_FREE = ("LSL", "LRL", "RSR", "RLR")  # what ends at a point has no last arc
_SIGN = {"L": 1.0, "S": 0.0, "R": -1.0}
# a via point's headings: how many at first; then around the best and `_BASINS` others, none of these below a spacing of `_COARSE` [rad]
_HEADINGS, _NEAR, _BASINS, _COARSE, _FINEST = 72, 9, 8, 1e-3, 1e-10
# an intercept: times tried at once, extra full turns, more than all arcs may add up to [rad]
_NODES, _LOOPS, _ARCS = 400, 2, 30.0


@dataclass(frozen=True)
class Curve:
    """Arcs of one radius and straights in a row."""

    word: str
    """A letter per part: arc to the left (L), straight (S), arc to the right (R)."""
    lengths: tuple[float, ...]
    """Length of each part [m]."""
    radius: float
    """Radius of all arcs [m]."""

    @property
    def length(self) -> float:
        """Sum of the lengths [m]."""
        return sum(self.lengths)

    def turn_rates(self, speed: float, times: Sequence[float] | np.ndarray) -> np.ndarray:
        """Mean turn rate (N,) [rad/s] between consecutive times (N+1,) [s] at constant speed [m/s]; 0 beyond the end.

        +speed / radius on L, -speed / radius on R, 0 on S, from time 0 on; where a part ends within a step, the mean keeps the
        heading exact at its ends. Raises InputError for a speed that is not above 0 and for times that do not increase.
        """
        require_positive("speed", speed)
        times = as_array("times", times)
        if times.ndim != 1 or not np.all(np.diff(times) > 0):
            raise InputError("times: must be a row of increasing numbers")
        return np.diff(self._heading_change(speed * times)) / np.diff(times)

    def poses(self, start: Pose, distances: Sequence[float] | np.ndarray) -> np.ndarray:
        """Poses (k, 3) after distances (k,) [m] along the curve from the start pose, held at either end beyond it."""
        x, y, heading = _numbers("start", start, 3)
        distances = as_array("distances", distances)
        at = np.clip(distances[:, None] - np.cumsum((0.0, *self.lengths[:-1])), 0, self.lengths)
        z, heading_change = _end_pose(self.word, at / self.radius)
        z = z * self.radius * np.exp(1j * heading)
        return np.stack([x + z.real, y + z.imag, heading + heading_change], axis=-1)

    def _heading_change(self, distance: np.ndarray) -> np.ndarray:
        """Change of heading [rad] after a distance [m]."""
        ends = np.cumsum((0.0, *self.lengths))
        bends = np.array([_SIGN[letter] for letter in self.word]) * self.lengths / self.radius
        return np.interp(distance, ends, np.cumsum((0.0, *bends)))


def curves(start: Pose, end: PoseOrPoint, radius: float) -> tuple[Curve, ...]:
    """Return the curve of each word that leads from start to end: LSL, LSR, LRL, RSR, RSL, RLR, as far as there is one.

    start: pose (x, y, heading) [m, m, rad]; end: a pose, or a point (x, y) whose heading is free: then the last arc has length 0.
    Middle arcs of LRL and RLR are the longer ones of the two that lead there, of at least half a turn: shortest curves have no
    others. Raises InputError for what is no pose and for a radius [m] that is not above 0.
    Source: Dubins (1957); Shkel and Lumelsky (2001), here by the centres of the circles, which loses no digits near the start;
    free headings: Boissonnat and Bui (1994).
    """
    require_positive("radius", radius)
    first, last = _numbers("start", start, 3), _numbers("end", end, 2, 3)
    words, parts = _parts_of_words(first, last, radius)
    return tuple(_curve(word, part, radius) for word, part in zip(words, parts, strict=True) if np.isfinite(part).all())


def shortest_curve(start: Pose, end: PoseOrPoint, radius: float) -> Curve:
    """Return the shortest curve between two poses that nowhere bends more sharply than a circle of a given radius.

    It is the shortest of the words LSL, LSR, LRL, RSR, RSL, RLR that lead there.

    Arguments:
        start: pose (x, y, heading) [m, m, rad].
        end: pose (x, y, heading) [m, m, rad], or a point (x, y) [m] whose heading is free.
        radius: least radius of curvature [m], > 0.
    Raises InputError for what is no pose and for other radii.
    Source: Dubins (1957); Shkel and Lumelsky (2001); free headings: Boissonnat and Bui (1994).
    """
    return min(curves(start, end, radius), key=lambda curve: curve.length)


def shortest_through(start: Pose, points: Sequence[Sequence[float]], end: PoseOrPoint | None = None, *, radius: float) -> tuple[Curve, ...]:
    """Return shortest curves in a row, from the start pose through via points (x, y) [m] in their order, headings there free.

    end: a pose, or a point with free heading; None = the last of the points. Curve i ends where curve i + 1 begins, with the same
    heading. The chain is the best over a grid of headings at the via points (dynamic programming over steps of 5 degrees, then of
    ever finer steps around the best ones): a good one, not proven to be the shortest. Raises InputError as `curves` does.
    """
    require_positive("radius", radius)
    targets = [np.array(as_pair(f"points[{i}]", point)) for i, point in enumerate(points)]
    if end is not None:
        targets.append(_numbers("end", end, 2, 3))
    if not targets:
        raise InputError("points: must be at least one where there is no end")
    via = np.array([target[:2] for target in targets[:-1]]).reshape(-1, 2)
    end_poses = _numbers("start", start, 3), targets[-1]
    spacing = 2 * np.pi / _HEADINGS
    candidates = [spacing * np.arange(_HEADINGS)] * len(via)
    best = _best_headings(end_poses, via, candidates, radius, _BASINS)
    while spacing > _FINEST:
        candidates = [np.ravel(headings[:, None] + np.linspace(-spacing, spacing, _NEAR)) for headings in best]
        spacing /= 3
        best = _best_headings(end_poses, via, candidates, radius, _BASINS if spacing > _COARSE else 0)
    poses = [end_poses[0], *np.column_stack([via, [headings[0] for headings in best]]), end_poses[1]]
    return tuple(shortest_curve(first, last, radius) for first, last in pairwise(poses))


def intercept(start: Pose, goal: PoseOrPoint, wind: tuple[float, float], speed: float, radius: float) -> Curve:
    """Return the curve in air that moves with a constant wind which, flown at constant airspeed, arrives at the goal first.

    It leads from start to goal - wind T in coordinates that move with the air, T = length / speed the time of flight itself, and
    is the shortest curve there; only where the shortest length jumps past speed T as T grows is it another of the six words, with
    up to two full turns more on its first arc. T is the first found on a grid of times, refined by bisection.
    goal: a point (x, y) [m], or a pose whose heading [rad] is that of the airspeed; wind (x, y) [m/s], speed [m/s], radius [m] in
    the air. Raises InputError as `curves` does, and where the wind is at least the speed and no such curve was found.
    Source: McGee, Spry and Hedrick (2005); Techy and Woolsey (2009).
    """
    require_positive("speed", speed)
    require_positive("radius", radius)
    first, last = _numbers("start", start, 3), _numbers("goal", goal, 2, 3)
    drift = np.zeros(len(last))
    drift[:2] = as_pair("wind", wind)
    detours = 2 * np.pi * radius * np.arange(_LOOPS + 1)

    def excess(t: np.ndarray) -> np.ndarray:
        """Length of curves less that of the flight (rows, len(t)): of the shortest; of each word, without loops; with one; ..."""
        lengths = _parts_of_words(first, last - np.multiply.outer(t, drift), radius)[1].sum(axis=-1) * radius
        return np.vstack([np.fmin.reduce(lengths, axis=0), *(lengths + detour for detour in detours)]) - speed * t

    times = _candidate_times(last[:2] - first[:2], drift[:2], speed, radius)
    slack = 1e-12 * (radius + float(np.abs(np.concatenate([first[:2], last[:2], speed * times[:1]])).max()))
    crossing = _first_zero(excess, times, slack)
    if crossing is None:
        raise InputError(
            f"wind is {tuple(drift[:2].tolist())!r}: {np.hypot(*drift[:2]):g} m/s against a speed of {speed:g} m/s carry the vehicle past "
            f"the goal {tuple(last.tolist())!r}; must be below the speed, or blow towards a goal that is far enough"
        )
    words, parts = _parts_of_words(first, last - crossing[0] * drift, radius)
    loops, word = divmod(crossing[1] - 1, len(words)) if crossing[1] else (0, int(np.nanargmin(parts.sum(axis=-1))))
    return _curve(words[word], parts[word] + np.array([2 * np.pi * loops, 0, 0]), radius)


def _numbers(what: str, value: PoseOrPoint, *counts: int) -> np.ndarray:
    """Return a point (2,) or a pose (3,), as `counts` allows."""
    array = as_array(what, value)
    if array.ndim != 1 or len(array) not in counts or not np.isfinite(array).all():
        accepted = {2: "a point (x, y)", 3: "a pose (x, y, heading)"}
        raise InputError(f"{what} is {value!r}: must be {' or '.join(accepted[count] for count in counts)} of finite numbers")
    return array


def _curve(word: str, part: np.ndarray, radius: float) -> Curve:
    return Curve(word, tuple((radius * part).tolist()), float(radius))


def _best_headings(
    end_poses: tuple[np.ndarray, np.ndarray], via: np.ndarray, candidates: Sequence[np.ndarray], radius: float, extra_minima: int
) -> list[np.ndarray]:
    """Return, for each via point (v, 2), its heading in the shortest chain of those tried, then up to `extra_minima` local minima there."""
    candidates = [np.unique(angles) for angles in candidates]
    poses = [np.column_stack([np.tile(point, (len(angles), 1)), angles]) for point, angles in zip(via, candidates, strict=True)]
    stages = pairwise([end_poses[0][None], *poses, end_poses[1][None]])
    legs = [np.fmin.reduce(_parts_of_words(first[:, None], last[None], radius)[1].sum(axis=-1), axis=0) for first, last in stages]
    costs_to_come, costs_to_go, chosen = [np.zeros(1)], [np.zeros(1)], [0]
    for cost_in, cost_out in zip(legs[:-1], legs[:0:-1], strict=True):
        costs_to_come.append(np.min(costs_to_come[-1][:, None] + cost_in, axis=0))
        costs_to_go.append(np.min(cost_out + costs_to_go[-1], axis=1))
    for cost_in, cost_out in zip(costs_to_come[:0:-1], legs[:0:-1], strict=True):
        chosen.append(int(np.argmin(cost_in + cost_out[:, chosen[-1]])))
    best = []
    for angles, cost_in, cost_out, i in zip(candidates, costs_to_come[1:], costs_to_go[:0:-1], chosen[:0:-1], strict=True):
        total = cost_in + cost_out
        minima = np.flatnonzero((total <= np.roll(total, 1)) & (total <= np.roll(total, -1)))
        best.append(np.append(angles[i], angles[minima[np.argsort(total[minima], kind="stable")][:extra_minima]]))
    return best


def _candidate_times(offset: np.ndarray, wind: np.ndarray, speed: float, radius: float) -> np.ndarray:
    """Times [s] to look for an intercept at, `offset` (2,) [m] ahead: none before the first at which |way - wind T| <= speed T."""
    a, b, c = wind @ wind - speed**2, offset @ wind, offset @ offset
    root = np.sqrt(max(b**2 - a * c, 0.0))
    is_slow_wind = bool(a < 0)
    if not is_slow_wind and c > 0 and (b <= 0 or b**2 < a * c):
        return np.zeros(0)
    first = c / (b + root) if b > 0 else (b - root) / a if is_slow_wind else 0.0
    longest = (
        (np.sqrt(c) + _ARCS * radius) / (speed - np.sqrt(wind @ wind)) if is_slow_wind else 1e6 * (np.sqrt(c) + _ARCS * radius) / speed
    )
    last = max(longest, first) if is_slow_wind else min(first + longest, (b + root) / a if a > 0 and c > 0 else np.inf)
    unit = radius / speed
    spread = first + unit * np.expm1(np.linspace(0, np.log1p((last - first) / unit), _NODES))
    closest = (b + np.linspace(-1, 1, _NODES) * _ARCS * radius * np.sqrt(wind @ wind)) / (wind @ wind) if np.any(wind) else spread
    return np.unique(np.clip(np.concatenate([spread, closest]), first, last))


def _first_zero(excess: Callable[[np.ndarray], np.ndarray], times: np.ndarray, slack: float) -> tuple[float, int] | None:
    """Return the first time at which a row of the excess falls to zero, and the row; None where all that fall jump past zero."""
    if len(times) == 0:
        return None
    values = excess(times)
    if np.nanmin(np.abs(values[:, 0])) <= slack:
        return float(times[0]), int(np.nanargmin(np.abs(values[:, 0])))
    for i, row in np.argwhere((~(values[:, :-1] <= 0) & (values[:, 1:] <= 0)).T):
        low, high = times[i], times[i + 1]
        for _ in range(20):
            inner = np.linspace(low, high, 9)
            past = int(np.argmax(excess(inner[1:])[row] <= 0)) + 1
            low, high = inner[past - 1], inner[past]
        if abs(excess(np.array([high]))[row, 0]) <= 1e3 * slack:
            return float(high), int(row)
    return None


# ---------------------------------------------------------------- in units of the radius, seen from the start pose, as complex numbers


def _parts_of_words(start: np.ndarray, end: np.ndarray, radius: float) -> tuple[tuple[str, ...], np.ndarray]:
    """Return W words and their parts (W, ..., 3) [radius] from starts (..., 3) to ends (..., 3) or (..., 2), NaN where there is none."""
    offset = end[..., :2] - start[..., :2]
    z = (offset[..., 0] + 1j * offset[..., 1]) * np.exp(-1j * start[..., 2]) / radius
    # more than rounding of the coordinates does to a pose
    sizes = (np.abs(pose / np.array([radius, radius, 1.0])[: pose.shape[-1]]).max(initial=0) for pose in (start, end))
    slack = 1e-11 + 16 * np.finfo(float).eps * sum(sizes)
    if end.shape[-1] == 2:
        parts = [*_to_point(z, slack), *_to_point(z.conj(), slack)]
        return _FREE, np.stack([_drop_full_turns(word, part, z, None, slack) for word, part in zip(_FREE, parts, strict=True)])
    turn = end[..., 2] - start[..., 2]
    parts = [*_to_pose(z, turn, slack), *_to_pose(z.conj(), -turn, slack)]
    return WORDS, np.stack([_drop_full_turns(word, part, z, turn, slack) for word, part in zip(WORDS, parts, strict=True)])


def _to_pose(z: np.ndarray, turn: np.ndarray, slack: float) -> tuple[np.ndarray, ...]:
    """Parts (..., 3) of LSL, LSR and LRL from the origin along the real axis to z with a heading of `turn`.

    By the way between the centres of the first and the last circle: p exp(i a), a the heading of the straight, for LSL;
    (p - 2i) exp(i a) for LSR; 4 sin(p / 2) exp(i (a - p / 2)), a the heading where the middle arc begins, for LRL.
    """
    chord = 2 * np.sin(turn / 2) * np.exp(0.5j * turn)  # i (1 - exp(i turn)), small where the turn is
    same, opposite = z - chord, z + chord - 2j
    along, apart = np.angle(same), np.abs(same)
    straight = _tangent_length(z + chord, 2, slack)
    crossing = np.angle(opposite) + np.arctan2(2, straight)
    middle = np.where(apart <= 4 + slack, 2 * np.pi - 2 * np.arcsin(np.minimum(apart / 4, 1)), np.nan)
    leaving = along + middle / 2
    return (
        _parts(along, apart, turn - along),
        _parts(crossing, straight, crossing - turn),
        _parts(leaving, middle, turn - leaving + middle),
    )


def _to_point(z: np.ndarray, slack: float) -> tuple[np.ndarray, ...]:
    """Parts (..., 3) of LS and LR from the origin along the real axis to z; a as in `_to_pose`.

    z - i, seen from the centre of the first circle, is (p - i) exp(i a) for LS, i (exp(-i p) - 2) exp(i a) for LR.
    """
    from_centre = z - 1j
    bearing, apart = np.angle(from_centre), np.abs(from_centre)
    straight = _tangent_length(z, 1, slack)
    arc = np.where(apart <= 3 + slack, 2 * np.pi - 2 * np.arcsin(np.minimum(straight / np.sqrt(8), 1)), np.nan)
    none = np.zeros_like(bearing)
    return (
        _parts(bearing + np.arctan2(1, straight), straight, none),
        _parts(bearing - np.angle(1j * (np.exp(-1j * arc) - 2)), arc, none),
    )


def _tangent_length(z: np.ndarray, offset: int, slack: float) -> np.ndarray:
    """sqrt(|z - other i|^2 - other^2), without cancellation near z = 0; NaN where that is imaginary by more than rounding."""
    squared = np.abs(z) ** 2 - 2 * offset * np.imag(z)
    return np.where(squared >= -2 * offset * slack, np.sqrt(np.maximum(squared, 0)), np.nan)


def _parts(first: np.ndarray, middle: np.ndarray, last: np.ndarray) -> np.ndarray:
    return np.stack([first % (2 * np.pi), middle, last % (2 * np.pi)], axis=-1)


def _drop_full_turns(word: str, parts: np.ndarray, z: np.ndarray, turn: np.ndarray | None, slack: float) -> np.ndarray:
    """Return parts (..., 3) without the full turns that come from rounding alone.

    Such are an arc of 2 pi - 1e-16 for 0, and what arcs do about a straight of 1e-16 in no direction in particular.
    """
    bends = [i for i, letter in enumerate(word) if _SIGN[letter]]
    suspect = (parts[..., bends].max(axis=-1) > 2 * np.pi - 1e-3) | (parts[..., 1] < 1e-3)
    if suspect.any():
        turns = None if turn is None else np.broadcast_to(turn, suspect.shape)[suspect]
        parts[suspect] = _shortest_of_few(word, parts[suspect], np.broadcast_to(z, suspect.shape)[suspect], turns, slack)
    return parts


def _shortest_of_few(word: str, parts: np.ndarray, z: np.ndarray, turn: np.ndarray | None, slack: float) -> np.ndarray:
    """The shortest of the parts (k, 3), the same without first, last, both or all arcs, and the first alone, that ends at the pose.

    What a dropped arc was short of a full turn is left to the other one, so that the last heading stays.
    """
    (first, middle, last), none = parts.T, np.zeros(len(parts))
    sign_ratio = _SIGN[word[0]] * _SIGN[word[2]]
    without_first = (none, middle, np.maximum(last + sign_ratio * (first - 2 * np.pi), 0))
    without_last = (np.maximum(first + sign_ratio * (last - 2 * np.pi), 0), middle, none)
    alone = none if turn is None else (_SIGN[word[0]] * turn) % (2 * np.pi)
    candidates = ((first, middle, last), without_first, without_last, (none, middle, none), (alone, none, none), (none, none, none))
    stacked = np.stack([np.stack(candidate, axis=-1) for candidate in candidates])
    end, heading = _end_pose(word, stacked)
    miss = np.abs(end - z)
    if turn is not None:
        miss = np.maximum(miss, np.abs(np.angle(np.exp(1j * (heading - turn)))))
    miss[0] = 0.0
    best = np.argmin(np.where(miss <= slack, stacked.sum(axis=-1), np.inf), axis=0)
    return stacked[best, np.arange(len(best))]


def _end_pose(word: str, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where parts (..., w) of a word of w letters lead from the origin along the real axis, and the heading there."""
    z, heading = np.zeros(parts.shape[:-1], dtype=complex), np.zeros(parts.shape[:-1])
    for letter, part in zip(word, np.moveaxis(parts, -1, 0), strict=True):
        chord = 2 * np.sin(part / 2) if _SIGN[letter] else part
        z = z + chord * np.exp(1j * (heading + _SIGN[letter] * part / 2))
        heading = heading + _SIGN[letter] * part
    return z, heading

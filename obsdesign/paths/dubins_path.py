"""Arcs of the sharpest turn and straights, switched at free times."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_positive
from obsdesign.errors import InputError
from obsdesign.paths import _columns, _switch_times, _switches
from obsdesign.paths.abstract import AbstractCheckablePath, Grid

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np

_TURN = "turn_rate"


@validate_arguments
@dataclass(frozen=True)
class DubinsPath(AbstractCheckablePath):
    """Arcs at the turn limit and straights in a given order, smoothed so that their durations can be optimised.

    turn_rate(t) = v_1 + sum_i (v_i+1 - v_i) S((t - s_i) / tau), u_k its mean over step k; every other input is constant.
    v_i: the upper bound of turn_rate on L, the lower one on R, 0 on S. s_i: sum of the durations d_1 ... d_i >= 0 [s] of the arcs
    before; the last arc lasts to the end, and what is due after the end does not happen. S(z) = 1 / (1 + exp(-z)), tau = blend / 4.
    Parameters p: d (letters - 1,), each in [0, N step], then the other inputs in their order.
    As s_i <= s_i+1, turn_rate(t) = sum_i v_i w_i with w_i = S((t - s_i-1) / tau) - S((t - s_i) / tau) >= 0 of sum 1: within bounds.
    Raises InputError for other values, no input turn_rate, or one that cannot turn to both sides. Source of the words: Dubins (1957).
    """

    word: str
    """Letters L (left), S (straight), R (right), no two equal ones in a row."""
    blend: float
    """Time [s], > 0, that a switch from one arc to the next would take at its greatest slope."""

    def __post_init__(self) -> None:
        if not isinstance(self.word, str) or not self.word or set(self.word) - set("LSR") or any(a == b for a, b in pairwise(self.word)):
            raise InputError(f"word is {self.word!r}: must be letters L, S and R, no two equal ones in a row, such as 'LSR'")
        require_positive("blend", self.blend)

    def box(self, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        """Return 0 and N step for every duration [s], then the bounds of the other inputs."""
        import numpy as np

        turn, switches = self._turn(grid), len(self.word) - 1
        lower, upper = (np.delete(np.array(side), turn) for side in (grid.lower, grid.upper))
        return np.concatenate([np.zeros(switches), lower]), np.concatenate([np.full(switches, grid.duration), upper])

    def require_suits(self, grid: Grid) -> None:
        """Raise InputError where there is no turn rate, or one whose bounds do not allow turns to both sides."""
        self._turn(grid)

    def inputs(self, p: ca.SX, grid: Grid) -> ca.SX:
        """Return u: the mean turn rate of every step, the other inputs constant."""
        import numpy as np

        turn, switches = self._turn(grid), len(self.word) - 1
        values = self._values(grid)
        rate = values[0] + _switches.switched_means(p[:switches], np.diff(values), self.blend / 4, grid)
        constants = [_columns.constant_input(p[switches + i], grid) for i in range(len(grid.names) - 1)]
        return _columns.stack_columns([*constants[:turn], rate, *constants[turn:]])

    def fit(self, u: np.ndarray, grid: Grid) -> np.ndarray:
        """Switches at the steps that are nearest in the least squares sense, then moved to where the squares are least."""
        import numpy as np

        turn = self._turn(grid)
        durations = _switch_times.fit_durations(u[:, turn], self._values(grid), self.blend / 4, grid)
        return np.clip(np.concatenate([durations, np.delete(u, turn, axis=1).mean(axis=0)]), *self.box(grid))

    def coarser(self) -> None:
        """Return None: few parameters already."""

    def rates(self, p: ca.SX, grid: Grid) -> ca.SX:
        """(1, m): (max v - min v) / blend, the slope where all switches between the two coincide; no path of the word is steeper.

        Its slope is sum_i (v_i+1 - v_i) S'((t - s_i) / tau) / tau, with S' <= 1 / 4 rising, then falling with i: a mean of sums of
        v_i+1 - v_i over consecutive i, times 1 / (4 tau) at most.
        """
        import numpy as np

        row = np.zeros((1, len(grid.names)))
        row[0, self._turn(grid)] = np.ptp(self._values(grid)) / self.blend
        return _columns.as_kind_of(p, row)

    def _turn(self, grid: Grid) -> int:
        """Index of the turn rate among the inputs."""
        if _TURN not in grid.names:
            raise InputError(f"dubins_path: needs an input {_TURN!r} (inputs: {', '.join(grid.names) or 'none'})")
        turn = grid.names.index(_TURN)
        if not grid.lower[turn] < 0 < grid.upper[turn]:
            bounds = (grid.lower[turn], grid.upper[turn])
            raise InputError(f"dubins_path: bounds of {_TURN} are {bounds!r}: must allow turns to both sides, lower < 0 < upper")
        return turn

    def _values(self, grid: Grid) -> np.ndarray:
        """v (letters,) [rad/s]."""
        import numpy as np

        turn = self._turn(grid)
        return np.array([{"L": grid.upper[turn], "S": 0.0, "R": grid.lower[turn]}[letter] for letter in self.word])

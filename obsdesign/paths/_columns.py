"""What path families share: the same formulas for symbolic and for numerical parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from obsdesign.errors import InputError
from obsdesign.paths.abstract import Grid

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np


def is_array(p: object) -> bool:
    """Return whether p is a NumPy array, not CasADi's."""
    import numpy as np

    return isinstance(p, np.ndarray)


def columns(p: Any, grid: Grid) -> Any:  # noqa: ANN401  # symbolic or numerical
    """Return p (q,) as (q / m, m): a column per input, one after the other."""
    import casadi as ca

    m = len(grid.names)
    return p.reshape(-1, m, order="F") if is_array(p) else ca.reshape(p, p.numel() // m, m)


def stack_columns(parts: list[Any]) -> Any:  # noqa: ANN401
    """Return columns (N, 1) or (N,) next to each other, (N, m)."""
    import casadi as ca
    import numpy as np

    return np.column_stack(parts) if is_array(parts[0]) else ca.horzcat(*parts)


def apply_matrix(matrix: np.ndarray, p: ca.SX, grid: Grid) -> ca.SX:
    """Return matrix (r, q / m) @ columns of p."""
    import casadi as ca

    return matrix @ columns(p, grid) if is_array(p) else ca.mtimes(ca.sparsify(ca.DM(matrix)), columns(p, grid))


def repeat_bounds(count: int, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Return each input's bounds `count` times: the box of parameters that are inputs themselves."""
    import numpy as np

    return np.repeat(np.array(grid.lower), count), np.repeat(np.array(grid.upper), count)


def require_at_most_steps(what: str, count: int, grid: Grid) -> None:
    """Raise InputError for more parameters per input than steps."""
    if count > grid.steps:
        raise InputError(f"{what} is {count}: must be at most the number of steps, {grid.steps}")


def constant_input(value: Any, grid: Grid) -> Any:  # noqa: ANN401
    """Return a constant input (N,) or (N, 1)."""
    import casadi as ca
    import numpy as np

    return ca.repmat(value, grid.steps, 1) if isinstance(value, ca.SX | ca.MX | ca.DM) else np.full(grid.steps, value)


def as_kind_of(p: Any, array: np.ndarray) -> Any:  # noqa: ANN401
    """Return an array that does not depend on p as what p is: symbolic or numerical."""
    return array if is_array(p) else type(p)(array)

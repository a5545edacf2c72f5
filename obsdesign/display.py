"""How records show themselves: some lines of text for a terminal, a table and a small picture for a notebook."""

from __future__ import annotations

import textwrap
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.errors import ObsdesignError

if TYPE_CHECKING:
    from pandas import DataFrame

LINES, WIDTH = 15, 100
_NAME = 40  # characters of a row's name
_SIZE, _MARGIN = 180.0, 6.0  # pixels of a small picture


class MissingPackageError(ObsdesignError, ImportError):
    """A package that is not installed is needed for what was asked."""


@dataclass(frozen=True)
class Summary:
    """What a record shows: a title, rows of a name and what it is, perhaps a picture (SVG)."""

    title: str
    rows: tuple[tuple[str, str], ...] = ()
    picture: str = ""

    def text(self) -> str:
        """Return at most 15 lines of 100 characters."""
        width = min(max((len(name) for name, _ in self.rows), default=0), _NAME)
        lines = [textwrap.shorten(self.title, WIDTH, placeholder=" ...")]
        for name, value in self.rows:
            short = textwrap.shorten(name, width, placeholder="...")
            wrapped = textwrap.wrap(value, WIDTH - width - 4) or [""]
            lines += [f"  {'' if row else short:{width}}  {line}" for row, line in enumerate(wrapped)]
        return "\n".join(lines if len(lines) <= LINES else [*lines[: LINES - 1], "  ..."])

    def html(self) -> str:
        """Return the table, and the picture beside it."""
        cell = "<td style='text-align:left'>"
        rows = "".join(f"<tr>{cell}{escape(name)}</td>{cell}{escape(value)}</td></tr>" for name, value in self.rows)
        return (
            f"<div style='display:flex;gap:1.5em;align-items:flex-start'><div><strong>{escape(self.title)}</strong>"
            f"<table>{rows}</table></div>{self.picture}</div>"
        )


class AbstractDisplay(ABC):
    """A record that shows what an engineer wants to read of it."""

    @abstractmethod
    def _summary(self) -> Summary:
        """Return what is shown."""

    def __str__(self) -> str:
        return self._summary().text()

    def _repr_html_(self) -> str:
        return self._summary().html()


def number(value: float, unit: str = "") -> str:
    """Return a number with four digits and its unit; nan as a dash."""
    return "-" if np.isnan(value) else f"{value:.4g}{f' {unit}' if unit else ''}"


def numbers(names: Sequence[str], values: Sequence[float] | np.ndarray) -> str:
    """Return names with their numbers: "x 1.2, y 3"."""
    return ", ".join(f"{name} {number(float(value))}" for name, value in zip(names, values, strict=True))


def line_picture(x: np.ndarray, y: np.ndarray) -> str:
    """Return the way through points (N,), (N,) as an SVG, to scale, y up, a dot where it begins."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    span = max(float(np.ptp(x)), float(np.ptp(y))) or 1.0
    across = _MARGIN + (x - x.min()) / span * (_SIZE - 2 * _MARGIN)
    down = _SIZE - _MARGIN - (y - y.min()) / span * (_SIZE - 2 * _MARGIN)
    step = max(len(across) // 400, 1)
    chosen = [*range(0, len(across) - 1, step), len(across) - 1]
    points = " ".join(f"{across[i]:.1f},{down[i]:.1f}" for i in chosen)
    dot = f"<circle cx='{across[0]:.1f}' cy='{down[0]:.1f}' r='3' fill='#222'/>"
    return _svg(_SIZE, _SIZE, f"<polyline points='{points}' fill='none' stroke='#0072B2' stroke-width='2'/>{dot}")


def state_picture(x: np.ndarray) -> str:
    """Return the way of the first two of the states (N, n) as an SVG; "" where there is one state."""
    return line_picture(x[:, 0], x[:, 1]) if x.shape[1] > 1 else ""


def raster_picture(on: np.ndarray) -> str:
    """Return what is on (K, S) as an SVG: a row for each of S, a column for each of K."""
    segments, rows = on.shape
    width, height = 320.0 / max(segments, 1), 16.0
    boxes = "".join(
        f"<rect x='{k * width:.2f}' y='{s * height + 1:.1f}' width='{width:.2f}' height='{height - 2:.1f}' fill='#0072B2'/>"
        for k, s in np.argwhere(on)
    )
    return _svg(320.0, rows * height, f"<rect width='320' height='{rows * height:.0f}' fill='#eee'/>{boxes}")


def raster_text(on: np.ndarray, max_marks: int = 60) -> list[str]:
    """Return a line of marks for each column of on (K, S): on all the time, some of it, or not, in at most so many marks."""
    segments = len(on)
    edges = np.linspace(0, segments, min(segments, max_marks) + 1).astype(int)
    shares = np.add.reduceat(on.astype(float), edges[:-1], axis=0) / np.diff(edges)[:, None]
    return ["".join("#" if share == 1 else "+" if share else "." for share in column) for column in shares.T]


def data_frame(columns: Mapping[str, np.ndarray], index: Mapping[str, np.ndarray]) -> DataFrame:
    """Return columns as a pandas DataFrame; index: its name and values. Raises MissingPackageError where pandas is not installed."""
    try:
        import pandas as pd
    except ImportError:
        raise MissingPackageError("to_dataframe needs pandas, which is not installed: pip install pandas") from None
    ((name, values),) = index.items()
    return pd.DataFrame(dict(columns), index=pd.Index(values, name=name))


def _svg(width: float, height: float, body: str) -> str:
    return f"<svg xmlns='http://www.w3.org/2000/svg' width='{width:.0f}' height='{height:.0f}'>{body}</svg>"

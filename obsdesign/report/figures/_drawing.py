"""What all figures share: size, type, colours, and how a figure becomes an inline SVG that is the same every time."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from threading import RLock
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from obsdesign.scenario.path_names import DESIGNED, STRAIGHT, WEAVE

WIDTH = 4.8  # inches: 10 pt text stays 10 px on a phone that is 400 px wide
BLUE, SKY, GREEN, ORANGE, VERMILLION, PURPLE = "#0072B2", "#56B4E9", "#009E73", "#E69F00", "#D55E00", "#CC79A7"  # Okabe and Ito
_LONG_LABEL = 28  # letters of a label beside which there is no room for another
INK, QUIET, FAINT = "#222222", "#767676", "#d4d4d4"

# colour of each path, the same in every figure
PATH_COLOURS = {STRAIGHT: VERMILLION, WEAVE: QUIET, DESIGNED: BLUE}
OTHER_PATHS = (GREEN, PURPLE, ORANGE, SKY, INK)

_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "obsdesign",
    "svg.fonttype": "path",  # text as outlines: the widths that were laid out are the widths that are shown
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.labelsize": 10.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.2,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.unicode_minus": True,
    "lines.linewidth": 1.5,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "hatch.linewidth": 0.6,
}
_STYLE_LOCK = RLock()  # Matplotlib's style belongs to the process
_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


@dataclass(frozen=True)
class Picture:
    """An inline SVG and the sentence that says what it means."""

    svg: str
    caption: str


def styled_figure(height: float, paint: Callable[[Figure], None], width: float = WIDTH) -> Figure:
    """Return the figure that `paint` draws on, whatever style its surroundings have; height, width [inches]."""
    with _style():
        figure = Figure(figsize=(width, height), layout="constrained")
        paint(figure)
        _lay_out(figure)
    return figure


def inline_svg(figure: Figure, name: str, description: str) -> str:
    """Return a figure as an <svg> element that scales with its container.

    name: prefix of all ids, unique on the page; description: what a screen reader says.
    """
    buffer = io.StringIO()
    with _style():
        if not _has_equal_axes(figure):  # what has its room keeps it: to lay it out takes as long as to draw it
            figure.set_layout_engine("none")
        FigureCanvasSVG(figure).print_svg(buffer, metadata=_NO_METADATA)  # savefig would draw it once more for itself
    return _svg_element(buffer.getvalue(), name, description)


@contextmanager
def _style() -> Iterator[None]:
    with _STYLE_LOCK, mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def path_colour(name: str, names: tuple[str, ...]) -> str:
    """Return the colour of a path among all paths of a study."""
    others = [candidate for candidate in names if candidate not in PATH_COLOURS]
    return PATH_COLOURS[name] if name in PATH_COLOURS else OTHER_PATHS[others.index(name) % len(OTHER_PATHS)]


def light_grid(axes: Axes, which: str = "both") -> None:
    """Draw faint grid lines behind everything."""
    axes.set_axisbelow(True)
    axes.grid(visible=True, axis=which, color=FAINT, linewidth=0.6)  # pyright: ignore[reportArgumentType]


def legend_below(figure: Figure, axes: Axes, columns: int = 2) -> None:
    """Put the legend of `axes` below everything, where it covers nothing."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=1 if max(map(len, labels), default=0) > _LONG_LABEL else columns)


def _svg_element(document: str, name: str, description: str) -> str:
    """Return the <svg> element alone: no prologue, no namespaces (HTML implies them), ids of its own, no fixed size."""
    svg = document[document.index("<svg") :].strip()
    head, body = svg.split(">", 1)
    view = re.search(r'viewBox="[^"]*"', head)
    if view is None:
        raise ValueError("the drawing has no viewBox")
    body = _prefix_ids(body, name)
    body = re.sub(r"<metadata>.*?</metadata>\s*", "", body, flags=re.DOTALL)
    body = re.sub(r'\sd="[^"]*"', lambda match: _round_coordinates(match[0]), body)
    return f'<svg {view[0]} role="img" aria-label="{_attribute(description)}">{body}'


def with_prefix(picture: Picture, prefix: str) -> Picture:
    """Return a picture whose ids differ from those of another picture of the same kind on the page."""
    return replace(picture, svg=_prefix_ids(picture.svg, prefix))


def _prefix_ids(svg: str, name: str) -> str:
    svg = re.sub(r'(\sid=")', rf"\g<1>{name}-", svg)
    svg = re.sub(r'(?:xlink:)?href="#', f'href="#{name}-', svg)
    return svg.replace("url(#", f"url(#{name}-")


def _round_coordinates(outline: str) -> str:
    """Return the points of an outline to a hundredth of a point."""
    return re.sub(r"-?\d+\.\d{3,}", lambda match: f"{float(match[0]):.2f}", outline)


def _attribute(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")


def _lay_out(figure: Figure) -> None:
    """Give labels their room; equal axes choose their limits when drawn, and it is the labels of those that need it."""
    engine = figure.get_layout_engine()
    if engine is None or _has_equal_axes(figure):
        figure.draw_without_rendering()
    else:
        engine.execute(figure)


def _has_equal_axes(figure: Figure) -> bool:
    return any(axes.get_aspect() == 1 for axes in figure.axes)

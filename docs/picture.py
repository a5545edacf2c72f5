"""Draw the pictures of the documents. Run by `make examples`."""

import re
from pathlib import Path

import numpy as np

import obsdesign as od
from obsdesign.report.figures._drawing import inline_svg
from obsdesign.report.figures.eigenvector_panels import EigenvectorPanel, draw_panels

ROOT = Path(__file__).parent.parent


def write(name: str, picture: str) -> None:
    """Write docs/<name>.svg, with the namespace that a file of its own needs."""
    if "xmlns=" not in picture:
        picture = picture.replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"', 1)
    (ROOT / "docs" / f"{name}.svg").write_text(picture + "\n", encoding="utf-8")


def first_of_the_example() -> str:
    """Return the first picture of the committed example's report."""
    page = (ROOT / "reports" / "examples" / "aerosonde_wind" / "report.html").read_text(encoding="utf-8")
    return re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL)[0]


def line_and_circle() -> str:
    """Return the eigenvectors of GPS information on a line and on a circle of equal time: Brace and Morgansen, fig. 4."""
    system, scale = od.System(od.Dubins(10.0, wind="constant"), (od.GPS(1.0),)), np.diag((1.0, 1.0, 0.1, 0.5, 0.5))
    panels = []
    for title, turn_rate in (("20 s on a line", 0.0), ("20 s on a circle", 2 * np.pi / 20)):
        path = od.simulate(system, (0.0, 0.0, 0.5, 2.0, -1.0), np.full(200, turn_rate), 0.1)
        values, vectors = np.linalg.eigh(scale @ od.variational_gramian(system, path).total @ scale)
        panels.append(EigenvectorPanel(title, np.where(values < 1e-12 * values[-1], 0.0, values), vectors))
    figure = draw_panels(panels, system.model.state_names)
    return inline_svg(figure, "eigenvectors", "Components of the eigenvectors of the information matrix")


if __name__ == "__main__":
    write("aerosonde_wind", first_of_the_example())
    write("line_and_circle", line_and_circle())

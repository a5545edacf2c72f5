"""Figures for notebooks: each is a Matplotlib Figure whose data are the record's."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection, QuadMesh
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle, StepPatch

import obsdesign as od
from obsdesign.report.figures._drawing import BLUE
from obsdesign.report.figures._map import shapes
from obsdesign.report.figures.decision_costs import deviation_costs

SYSTEM = od.System(od.Dubins(5.0, wind="constant"), (od.GPS(2.0), od.Range((50.0, 20.0), 1.0), od.Bearing((50.0, 20.0), 0.1)))
START = (0.0, 0.0, 0.2, 1.0, -0.5)
STATES = SYSTEM.model.states


@pytest.fixture(scope="module")
def design() -> od.Design:
    problem = od.DesignProblem(
        system=SYSTEM,
        start=START,
        duration=12.0,
        step=1.0,
        path=od.PiecewiseConstant(3),
        bounds={"turn_rate": (-0.3, 0.3)},
        criterion=od.MinEigenvalue(),
        scale=(5.0, 5.0, 0.2, 1.0, 1.0),
        constraints=(od.KeepOut((20.0, 30.0), 8.0), od.StandOff(4.0)),
    )
    return od.design_trajectory(problem, starts=1)


@pytest.fixture(scope="module")
def blocks(design) -> np.ndarray:
    return design.problem.scaled(design.information.by_segment(6))


@pytest.fixture(scope="module")
def schedule(blocks) -> od.Schedule:
    return od.select_sensors(blocks, per_segment=1, rules=(od.MaxUses(1, 3),))


@pytest.fixture(scope="module")
def validation(design) -> od.Validation:
    return od.validate(SYSTEM, design.trajectory, prior=od.Prior(START, std=(5.0, 5.0, 0.2, 1.0, 1.0)), runs=10)


@pytest.fixture(scope="module")
def flight() -> od.Flight:
    random, t = np.random.default_rng(0), np.arange(5.0)
    truth, mean = random.standard_normal((2, 5, 5))
    flight = od.Flight(t, truth, mean, random.random((5, 5)), np.zeros((4, 1)), np.ones(5), 1.0)
    return replace(flight, straight=flight)


def lines(figure: Figure, panel: int = 0) -> list[tuple[np.ndarray, np.ndarray]]:
    """x and y of every line of a panel."""
    return [tuple(np.asarray(values, dtype=float) for values in line.get_data()) for line in figure.axes[panel].lines]


def has_line(figure: Figure, x: np.ndarray, y: np.ndarray, panel: int = 0) -> bool:
    """Whether a panel has that line."""
    return any(a.shape == np.shape(x) and np.allclose(a, x) and np.allclose(b, y) for a, b in lines(figure, panel))


def test_a_path_is_drawn_where_it_goes_in_the_colours_of_its_information(design):
    figure = od.figures.path(design)
    (segments,) = (each for each in figure.axes[0].collections if isinstance(each, LineCollection))
    drawn = [path.vertices for path in segments.get_paths()]
    place = design.trajectory.x[:, :2]
    np.testing.assert_allclose(np.vstack([drawn[0][:1], *(part[1:] for part in drawn)]), place)
    W = design.problem.scaled(design.information.total)
    values, vectors = np.linalg.eigh(W)
    v = vectors[:, 0]
    turned = len(v) * np.finfo(float).eps * values[-1] / (values[1] - values[0])  # how far rounding turns the eigenvector
    shares = np.einsum("i,kij,j->k", v, design.problem.scaled(design.information.blocks.sum(axis=1)), v) / (v @ W @ v)
    np.testing.assert_allclose(segments.get_array(), 100 * shares, rtol=1e-6, atol=100 * turned)
    problem = design.problem
    assert len(figure.axes[0].patches) >= len(shapes(problem.constraints, SYSTEM.model.landmarks)) == 2


def test_the_inputs_are_those_of_the_path_and_its_bounds_in_degrees(design):
    axes = od.figures.inputs(design).axes[0]
    (steps,) = (patch for patch in axes.patches if isinstance(patch, StepPatch))
    np.testing.assert_allclose(steps.get_data().values, np.degrees(design.trajectory.u[:, 0]))
    np.testing.assert_allclose(sorted(line.get_ydata()[0] for line in axes.lines), np.degrees([-0.3, 0.3]))


def test_the_eigenvalues_and_eigenvectors_are_those_of_what_all_sensors_say(design):
    values, vectors = np.linalg.eigh(design.problem.scaled(design.information.total))
    figure = od.figures.spectrum(design)
    assert has_line(figure, np.zeros(4), values[1:])
    assert has_line(figure, np.zeros(1), values[:1])
    (mesh,) = (each for each in od.figures.eigenvectors(design).axes[0].collections if isinstance(each, QuadMesh))
    np.testing.assert_allclose(np.abs(mesh.get_array()), np.abs(vectors))


@pytest.mark.parametrize("draw", ["path", "inputs", "spectrum", "eigenvectors"])
def test_a_design_without_a_path_is_an_error_that_says_why(design, draw):
    failed = replace(design, trajectory=None, information=None, ended=od.Status.LOCALLY_INFEASIBLE)
    with pytest.raises(od.InputError, match="has no path to draw"):
        getattr(od.figures, draw)(failed)


def test_a_sensor_is_blue_where_it_is_on(schedule):
    for t in (None, np.arange(7) * 2.0):
        axes = od.figures.schedule(schedule, names=("gps", "range", "bearing"), t=t).axes[0]
        on = [bar for bar in axes.patches if isinstance(bar, Rectangle) and bar.get_facecolor() == to_rgba(BLUE)]
        step = 1.0 if t is None else 2.0
        drawn = {(round(bar.get_x() / step), round(bar.get_y() + bar.get_height() / 2)) for bar in on}
        assert drawn == {(int(k), int(s)) for k, s in np.argwhere(schedule.chosen)}
        assert [label.get_text() for label in axes.get_yticklabels()] == ["gps", "range", "bearing"]


def test_regrets_are_by_how_much_the_bound_falls(schedule):
    mesh = [each for each in od.figures.regret(schedule).axes[0].collections if isinstance(each, QuadMesh)][-1]
    cost, drawn = deviation_costs(schedule).T, np.ma.filled(mesh.get_array(), np.inf)
    np.testing.assert_array_equal(np.isinf(drawn), np.isinf(cost))
    inside = (cost > 1e-2) & (cost < min(100.0, cost[np.isfinite(cost)].max()))
    np.testing.assert_allclose(drawn[inside], cost[inside])


def test_a_front_is_its_schedules_and_what_none_is_above(blocks):
    pareto = od.pareto(blocks, od.EnergyBudget(cost={1: 1.0, 2: 3.0}, limit=10.0), points=3, per_segment=1)
    figure, order = od.figures.front(pareto), np.argsort(pareto.spent)
    assert has_line(figure, pareto.spent[order], pareto.values[order])
    (limits, above), *_ = lines(figure)
    np.testing.assert_allclose(above, [pareto.above(limit) for limit in limits])


def test_nees_and_errors_are_those_of_the_runs(validation):
    assert has_line(od.figures.consistency(validation), validation.t, validation.nees)
    figure = od.figures.errors(validation, STATES)
    for i, factor in enumerate((1.0, 1.0, np.degrees(1.0), 1.0, 1.0)):
        assert has_line(figure, validation.t, factor * validation.rmse[:, i], panel=i)
        assert has_line(figure, validation.t, factor * validation.bound[:, i], panel=i)


def test_estimates_of_a_flight_are_those_of_its_filter(flight):
    figure = od.figures.estimates(flight)
    for i in range(5):
        assert has_line(figure, flight.t, flight.mean[:, i], panel=i)
        assert has_line(figure, flight.t, flight.truth[:, i], panel=i)


def test_every_figure_is_a_figure(design, schedule, validation, flight):
    drawn = {
        **{name: getattr(od.figures, name)(design) for name in ("path", "inputs", "spectrum", "eigenvectors")},
        **{name: getattr(od.figures, name)(schedule) for name in ("schedule", "regret")},
        **{name: getattr(od.figures, name)(validation) for name in ("consistency", "errors")},
        "estimates": od.figures.estimates(flight),
    }
    assert {*drawn, "front", "singular"} == set(od.figures.__all__)
    assert all(isinstance(figure, Figure) for figure in drawn.values())


def test_matplotlib_loads_when_a_figure_is_asked_for():
    lazily = "od.figures; assert 'matplotlib' not in sys.modules; od.figures.path; assert 'matplotlib' in sys.modules"
    code = f"import sys, obsdesign as od; {lazily}"
    subprocess.run([sys.executable, "-c", code], check=True)

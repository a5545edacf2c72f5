"""Design and selection with errors of samples that are not independent: exact values, exact derivatives, amounts from below."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import obsdesign as od
from obsdesign.design.feasibility import initial_rows
from obsdesign.design.floor import Floor
from obsdesign.design.nlp.joint_program import JointProgram
from obsdesign.design.nlp.program import Program
from obsdesign.design.upper_bound import cap_of
from obsdesign.design.weave import best_weave
from obsdesign.joint.problem import JointProblem

BEACON = (40.0, 25.0)
SENSORS = (
    od.GPS(2.0, rate=1.0, correlation=0.8, bias_floor=1.0),
    od.Magnetometer(0.2, name="compass"),
    od.Range(BEACON, 1.0, sigma_per_metre=0.05, max_range=60.0, correlation=0.7, rate=2.0),
    od.Range((-30.0, 10.0), 1.0, name="left", bias_floor=0.3),
    od.Range((-30.0, 14.0), 1.0, name="right", rate=2.0),
)
SYSTEM = od.System(od.Unicycle(wind="constant"), SENSORS, joint_noise={("right", "left"): ((1.5, 0.9), (0.9, 1.0))})
START, STEP, STEPS = np.array([3.0, -1.0, 0.4, 2.0, -1.0]), 0.25, 24
SCALE = np.array([5.0, 4.0, 0.3, 1.0, 1.5])
BOUNDS = {"speed": (5.0, 12.0), "turn_rate": (-0.6, 0.6)}
WEIGHTS = np.random.default_rng(3).random((4, len(SENSORS)))
P = np.array([[9.0, 0.3], [8.0, -0.4], [10.0, 0.5], [9.5, -0.2]]).ravel(order="F")


def problem(**fields: object) -> od.DesignProblem:
    path = od.PiecewiseConstant(4)
    return od.DesignProblem(SYSTEM, START, STEPS * STEP, STEP, path, BOUNDS, scale=SCALE, **fields)  # pyright: ignore[reportArgumentType]


def path_of(p: np.ndarray) -> od.Trajectory:
    return od.simulate(SYSTEM, START, np.repeat(p.reshape(2, 4).T, STEPS // 4, axis=0), STEP)


def differences(values: object, p: np.ndarray, eps: float = 1e-5) -> np.ndarray:
    """Central differences along each parameter, first axis."""
    steps = eps * np.eye(len(p))
    return np.array([(values(p + step) - values(p - step)) / (2 * eps) for step in steps])  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize("fields", [{}, {"weights": WEIGHTS}, {"weights": np.round(WEIGHTS)}], ids=["all", "shares", "schedule"])
def test_a_program_has_the_exact_value_and_its_derivatives(fields: dict[str, object]):
    asked = problem(**fields)
    program = Program(asked)
    values = program.evaluate(P)
    np.testing.assert_allclose(values.matrices[0], asked.scaled(asked.information_matrix(path_of(P))), rtol=1e-8, atol=1e-8)
    expected = differences(lambda p: asked.scaled(asked.information_matrix(path_of(p))), P)
    np.testing.assert_allclose(program.derivatives(values).matrices[0], expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_a_floor_is_that_of_windows_which_know_nothing_of_errors_before():
    asked = problem(floor=Floor(2.0, 1e-6))
    program = Program(asked)
    values = program.evaluate(P)
    windows = od.sliding_information(SYSTEM, path_of(P), 8).sum(axis=1)[[0, 4, 8, 12, 16]]
    np.testing.assert_allclose(values.floors, asked.scaled(windows), rtol=1e-8, atol=1e-8)
    expected = differences(lambda p: program.evaluate(p).floors, P)
    found = program.derivatives(values).floors.swapaxes(0, 1)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_a_relaxed_schedule_weighs_the_amounts_that_the_selection_chooses_from():
    asked = problem()
    relaxed = JointProgram(Program(asked, initial_rows(asked), 4), 4, 2)
    v = relaxed.join(P, WEIGHTS)
    values = relaxed.evaluate(v)
    blocks = asked.scaled(od.segment_information(SYSTEM, path_of(P), 4))
    np.testing.assert_allclose(values.matrices[0], np.einsum("ks,ksij->ij", WEIGHTS, blocks), rtol=1e-8, atol=1e-8)
    expected = differences(lambda v: relaxed.evaluate(v).matrices[0], v)
    np.testing.assert_allclose(relaxed.derivatives(values).matrices[0], expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_weights_beyond_one_of_errors_that_are_not_independent_are_refused():
    heavy = np.ones((4, len(SENSORS)))
    heavy[0, 1] = 2.0  # the compass is white: its samples may count twice
    assert problem(weights=heavy).value(path_of(P)) > problem().value(path_of(P))
    heavy[0, 0] = 2.0
    with pytest.raises(od.InputError, match=r"weights of gps.*go beyond 1"):
        problem(weights=heavy)


GPS_ONLY = od.System(
    od.Dubins(speed=10.0, wind="constant"), (od.GPS(2.0, correlation=0.9, bias_floor=1.0), od.Magnetometer(0.2, bias_floor=0.1))
)


def dubins(system: od.System) -> od.DesignProblem:
    return od.DesignProblem(
        system,
        np.array([0.0, 0.0, 0.0, 1.0, 1.0]),
        20.0,
        0.5,
        od.PiecewiseConstant(4),
        {"turn_rate": (-0.3, 0.3)},
        scale=(5, 5, 0.05, 1, 1),
    )


def test_a_cap_is_that_of_the_noise_that_is_stated():
    """GPS of one coordinate: rows (1, t) of position and wind, R = s^2 c^|i - j| + b^2; the same for the other. No path changes it."""
    asked, t = dubins(GPS_ONLY), 0.5 * np.arange(40)
    R = 4.0 * 0.9 ** np.abs(np.arange(40)[:, None] - np.arange(40)) + 1.0
    A = np.column_stack([np.ones(40), t]) * (5.0, 1.0)
    cap = cap_of(asked)
    assert cap is not None
    assert cap.states == ("x", "y", "wind_x", "wind_y")
    assert cap.value == pytest.approx(np.linalg.eigvalsh(A.T @ np.linalg.solve(R, A))[0], rel=1e-9)
    random = np.random.default_rng(5)
    for _ in range(20):
        u = np.repeat(random.uniform(-0.3, 0.3, (4, 1)), 10, axis=0)
        assert asked.value(od.simulate(GPS_ONLY, asked.x0, u, 0.5)) <= cap.value


def test_what_depends_on_the_place_has_no_cap():
    growing = od.System(GPS_ONLY.vehicle, (*GPS_ONLY.sensors, od.Range((50.0, 50.0), 1.0, correlation=0.5)))
    assert cap_of(dubins(growing)) is None


def test_a_designed_path_is_a_local_optimum_of_the_exact_value():
    asked = dubins(GPS_ONLY)
    design = od.design_trajectory(asked, starts=2, seed=0)
    assert design.trajectory is not None
    assert design.value == pytest.approx(
        asked.criterion.value(asked.scaled(od.variational_gramian(GPS_ONLY, design.trajectory).total)), rel=1e-9
    )
    best = best_weave(asked)
    assert best is not None
    assert design.value >= asked.value(best[1]) * (1 - 1e-6)
    random, u = np.random.default_rng(6), design.trajectory.u[::10]
    for _ in range(30):  # no path close by is better
        near = np.clip(u + 0.01 * random.standard_normal(u.shape), -0.3, 0.3)
        assert asked.value(od.simulate(GPS_ONLY, asked.x0, np.repeat(near, 10, axis=0), 0.5)) <= design.value * (1 + 1e-6)


def test_no_schedule_of_a_joint_question_is_worth_less_than_it_is_counted_for():
    asked = problem()
    question = JointProblem(asked, 3, 2, (), 0, 1)
    blocks = question.blocks(path_of(P))
    information = od.variational_gramian(SYSTEM, path_of(P))
    rows = [np.array(bits) for bits in product((False, True), repeat=len(SENSORS)) if sum(bits) == 2]
    random = np.random.default_rng(7)
    for _ in range(100):
        chosen = np.array([rows[i] for i in random.integers(0, len(rows), 3)])
        exact = asked.scaled(information.under(np.repeat(chosen, STEPS // 3, axis=0)))
        assert np.linalg.eigvalsh(exact - blocks[chosen].sum(axis=0))[0] >= -1e-9 * np.trace(exact)


def test_a_path_for_which_nothing_is_on_is_worth_nothing():
    asked = od.DesignProblem(GPS_ONLY, np.zeros(5), 5.0, 0.5, od.PiecewiseConstant(2), {"turn_rate": (-0.3, 0.3)}, weights=np.zeros((2, 2)))
    assert od.design_trajectory(asked, starts=2, seed=0, throw=False).value == 0.0


def test_a_study_tells_what_the_chosen_samples_say_together(tmp_path: Path):
    """Errors that last: exact_value beside the value, in the result and on the page."""
    text = (Path(__file__).parents[1] / "scenarios" / "dubins_sensor_selection.toml").read_text().split("[[expected]]")[0]
    text = text.replace("sigma = 2.0", "correlation = 0.8\nbias_floor = 0.5\nsigma = 2.0", 1).replace("runs = 100", "runs = 2")
    text = (
        text.replace("seconds = 40.0", "seconds = 10.0")
        .replace("duration = 120.0", "duration = 30.0")
        .replace("after = 30.0", "after = 20.0")
    )
    before, after = text.split('[[paths]]\nname = "straight"')
    (tmp_path / "lasting.toml").write_text(before + "[selection]" + after.split("[selection]")[1])
    study = od.run(od.load_scenario(tmp_path / "lasting.toml"))
    od.write_report(tmp_path / "out", study)
    part = json.loads((tmp_path / "out" / "result.json").read_text())["selection"]
    assert "chosen, all its samples together" in (tmp_path / "out" / "report.html").read_text()
    each = np.repeat(np.array(part["chosen"]), np.diff(study.main.nodes), axis=0)
    W = study.problem.scaled(study.main.information.under(each))
    assert part["exact_value"] == pytest.approx(np.linalg.eigvalsh(W)[0], rel=1e-9)
    assert part["exact_value"] > part["value"]

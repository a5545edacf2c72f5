"""What records show of themselves: some lines, a table and a picture that a browser reads, and data frames."""

import sys
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import pytest

import obsdesign as od
from obsdesign.display import LINES, WIDTH, MissingPackageError, Summary, line_picture, raster_picture, raster_text, state_picture

SYSTEM = od.System(
    od.Dubins(speed=15.0, wind="constant"),
    (od.GPS(sigma=2.0), od.Magnetometer(sigma=0.21), od.Range((500.0, 200.0), sigma=1.0)),
)
START, STD = np.array([0.0, 0.0, 0.3, 3.0, -2.0]), np.array([50.0, 50.0, 0.1, 5.0, 5.0])


@pytest.fixture(scope="module")
def records():
    path = od.simulate(SYSTEM, START, 0.2 * np.sin(np.arange(40) / 5)[:, None], 0.5)
    information = od.variational_gramian(SYSTEM, path)
    prior = od.Prior(START, std=STD)
    problem = od.DesignProblem(
        system=SYSTEM,
        start=START,
        duration=20.0,
        step=0.5,
        path=od.PiecewiseConstant(pieces=4),
        bounds={"turn_rate": (-0.3, 0.3)},
        scale=STD,
        constraints=(od.StandOff(50.0),),
    )
    schedule = od.select_sensors(information.by_segment(8))
    return {
        "system": SYSTEM,
        "verdict": od.observability(od.System(SYSTEM.vehicle, SYSTEM.sensors[:1]), held={"turn_rate": 0.0}),
        "path": path,
        "information": information,
        "prior": prior,
        "problem": problem,
        "design": od.design_trajectory(problem, starts=1, seed=0),
        "schedule": schedule,
        "validation": od.validate(SYSTEM, path, schedule, prior=prior, runs=10),
        "contributions": od.contributions(SYSTEM, information, 8),
        "perturbation": od.perturbation(SYSTEM, path),
        "pareto": od.pareto(information.by_segment(8), od.EnergyBudget(40.0, {0: 1.0, 1: 1.0, 2: 8.0}), points=4),
    }


def test_every_record_prints_on_a_screen(records):
    for name, record in records.items():
        lines = str(record).splitlines()
        assert 1 < len(lines) <= LINES, name
        assert max(map(len, lines)) <= WIDTH, name


def test_every_record_is_a_table_that_a_browser_reads(records):
    for record in records.values():
        tree = ElementTree.fromstring(record._repr_html_())
        assert tree.tag == "div"
        assert len(tree.findall(".//tr")) >= 1


def test_what_is_printed_is_what_was_found(records):
    verdict, schedule, design = records["verdict"], records["schedule"], records["design"]
    assert str(verdict).startswith(f"{verdict.dimension} of 5 dimensions seen, decided")
    assert " ".join(verdict.hidden.split()[:4]) in str(verdict)
    assert f"{schedule.value:.4g}" in str(schedule)
    for s in range(3):  # a mark for each segment
        assert f"sensor {s}              {''.join('#' if on else '.' for on in schedule.chosen[:, s])}" in str(schedule)
    assert f"{design.value:.4g}" in str(design)
    assert design.status.value in str(design)
    towards_a_beacon = od.System(od.Dubins(10.0), (od.Range((500.0, 0.0), 1.0),))
    assert "hidden" in str(od.variational_gramian(towards_a_beacon, od.simulate(towards_a_beacon, [0, 0, 0], np.zeros((5, 1)), 1.0)))


def test_a_path_of_one_state_has_no_picture_and_long_names_are_shortened():
    x = ca.SX.sym("x", 1)
    system = od.ControlAffineSystem(x, ("v",), drift=-x, outputs={"y": x})
    path = od.simulate(system, [1.0], np.zeros((4, 0)), 0.1)
    assert "svg" not in path._repr_html_()
    assert state_picture(np.ones((5, 1))) == ""
    assert "svg" in state_picture(np.ones((5, 2)))
    lines = Summary("a title", (("a name of many letters " * 8, "1"), ("b", "words " * 30))).text().splitlines()
    assert max(map(len, lines)) <= WIDTH


def test_long_records_are_cut():
    summary = Summary("a title", tuple((f"row {i}", "words " * 40) for i in range(40)))
    assert len(summary.text().splitlines()) == LINES
    assert summary.text().endswith("...")


def test_marks_say_how_much_of_a_stretch_is_on():
    on = np.zeros((120, 2), dtype=bool)
    on[:60, 0] = True
    on[::2, 1] = True
    assert raster_text(on) == ["#" * 30 + "." * 30, "+" * 60]
    assert raster_text(on[:3]) == ["###", "#.#"]


def test_pictures_are_drawn_to_scale():
    points = ElementTree.fromstring(line_picture(np.array([0.0, 10.0, 10.0]), np.array([0.0, 0.0, 5.0]))).find(".//{*}polyline")
    first, second, third = (np.array(pair.split(","), float) for pair in points.get("points").split())
    assert second[0] - first[0] == pytest.approx(2 * (second[1] - third[1]), abs=0.2)  # 10 m across are twice 5 m up
    assert third[1] < second[1]  # y points up
    boxes = ElementTree.fromstring(raster_picture(np.array([[True, False], [True, True]]))).findall(".//{*}rect")
    assert len(boxes) == 1 + 3  # the ground, and one for each that is on
    assert ElementTree.fromstring(line_picture(np.zeros(3), np.zeros(3))) is not None  # a path that stays where it is


def test_data_frames_hold_the_numbers(records):
    pytest.importorskip("pandas")
    path, validation = records["path"], records["validation"]
    frame = path.to_dataframe()
    assert frame.index.name == "t"
    np.testing.assert_array_equal(frame[["x0", "x1", "x2", "x3", "x4"]].to_numpy(), path.x)
    np.testing.assert_array_equal(frame["u0"].to_numpy()[:-1], path.u[:, 0])
    np.testing.assert_array_equal(records["schedule"].to_dataframe().to_numpy(), records["schedule"].chosen)
    np.testing.assert_array_equal(validation.to_dataframe()["nees"].to_numpy(), validation.nees)
    np.testing.assert_allclose(records["contributions"].to_dataframe().sum(axis=1), 1.0)
    np.testing.assert_array_equal(records["pareto"].to_dataframe()["value"].to_numpy(), records["pareto"].values)


def test_without_pandas_the_error_names_it(records, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingPackageError, match="needs pandas, which is not installed"):
        records["path"].to_dataframe()

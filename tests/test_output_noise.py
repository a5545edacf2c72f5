"""A system of one's own with all that ready-made sensors have: the same numbers, from the verdict to the filter."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest

import obsdesign as od
from obsdesign.dynamics.measurement_noise import detections
from obsdesign.dynamics.simulation import readings

PLACE = (30.0, 20.0)
x = ca.SX.sym("x", 3)
east, north = PLACE[0] - x[0], PLACE[1] - x[1]
r = (east**2 + north**2) ** 0.5
KNOWN = {"speed": ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), 0), "turn_rate": ca.SX([0, 0, 1])}
OUTPUTS = {"gps": x[:2], "magnetometer": x[2], "tree": ca.vertcat(r, ca.atan2(north, east) - x[2])}
NOISES = {
    "gps": od.OutputNoise((2.0, 2.0), rate=1.0, inflation=1.4, correlation=0.5),
    "magnetometer": od.OutputNoise(0.2, bias_floor=0.1, rate=2.0),
    "tree": od.OutputNoise(
        ca.vertcat(ca.sqrt(1 + (0.05 * r) ** 2), 0.05), 1 / (1 + ca.exp((r / 40 - 1) / 0.05)), detection=0.7, landmarks=(PLACE,)
    ),
}
OWN = od.ControlAffineSystem(
    x, ("x", "y", "heading"), None, KNOWN, {}, OUTPUTS, angles=("heading", "magnetometer", "tree_2"), noises=NOISES
)
READY = od.System(
    od.Unicycle(),
    (
        od.GPS(2.0, rate=1.0, inflation=1.4, correlation=0.5),
        od.Magnetometer(0.2, bias_floor=0.1, rate=2.0),
        od.RangeBearing(PLACE, 1.0, bearing_sigma=0.05, sigma_per_metre=0.05, max_range=40.0, detection=0.7, name="tree"),
    ),
)
U = np.column_stack([6.0 + np.sin(np.arange(24) / 9), 0.4 * np.cos(np.arange(24) / 7)])
PATH = od.simulate(OWN, [0.0, 0.0, 0.3], U, 0.25)
PRIOR, PSD = od.Prior([1.0, -1.0, 0.2], std=(3.0, 3.0, 0.2)), (0.01, 0.01, 0.001)


def test_a_system_of_ones_own_is_the_ready_made_one():
    assert OWN.model.sensor_names == READY.model.sensor_names
    assert [signal.name for signal in OWN.model.outputs] == ["gps_1", "gps_2", "magnetometer", "tree_1", "tree_2"]
    assert [signal.is_angle for signal in OWN.model.outputs] == [signal.is_angle for signal in READY.model.outputs]
    assert OWN.model.landmarks == READY.model.landmarks == (PLACE,)
    assert od.observability(OWN).dimension == od.observability(READY).dimension == 3
    for one, other in zip(vars(readings(OWN, PATH.x[None])).values(), vars(readings(READY, PATH.x[None])).values(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)
    W = [od.variational_gramian(system, PATH) for system in (OWN, READY)]
    np.testing.assert_allclose(W[0].blocks, W[1].blocks, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(W[0].total, W[1].total, rtol=1e-10)
    J = [od.posterior_information(system, PATH, PRIOR, PSD) for system in (OWN, READY)]
    np.testing.assert_allclose(J[0], J[1], rtol=1e-10, atol=1e-9)
    y = readings(READY, PATH.x[None, :-1]).y[0] + np.random.default_rng(1).standard_normal((24, 5)) * [2, 2, 0.2, 1, 0.05]
    estimates = [od.estimate_states(system, PRIOR, U, y, 0.25, disturbance_psd=PSD) for system in (OWN, READY)]
    np.testing.assert_allclose(estimates[0].mean, estimates[1].mean, rtol=1e-10, atol=1e-11)
    drawn = [detections(system.model, np.random.default_rng(0), 50) for system in (OWN, READY)]
    np.testing.assert_array_equal(*drawn)


def test_it_travels_between_processes_and_equals_its_copy_and_no_other():
    copy = pickle.loads(pickle.dumps(OWN))
    assert copy == OWN
    assert hash(copy) == hash(OWN)
    np.testing.assert_allclose(od.variational_gramian(copy, PATH).total, od.variational_gramian(OWN, PATH).total, rtol=1e-12)
    for changed in ({**NOISES, "magnetometer": od.OutputNoise(0.2)}, {**NOISES, "gps": od.OutputNoise(2.0, ca.cos(x[0]) ** 2)}):
        assert od.ControlAffineSystem(x, OWN.names, None, KNOWN, {}, OUTPUTS, angles=OWN.angles, noises=changed) != OWN


def test_sigma_of_a_vector_may_be_one_number_and_angles_may_be_named_as_a_whole():
    both = od.ControlAffineSystem(x, ("x", "y", "heading"), outputs={"both": x[1:]}, angles=("both",), sigmas={"both": 0.5})
    assert all(signal.is_angle for signal in both.model.outputs)
    path = od.simulate(both, [0.0, 0.0, 0.0], np.zeros((1, 0)), 1.0)
    np.testing.assert_allclose(od.variational_gramian(both, path).total, np.diag([0.0, 4.0, 4.0]), atol=1e-12)


def test_a_log_has_the_entries_of_a_vector_as_columns(tmp_path):
    file = tmp_path / "run.csv"
    file.write_text("t,speed,turn_rate,tree_1,tree_2 [deg]\n0,6,0.1,,\n0.5,6,0.1,31.5,20\n1,6,0.1,28.2,21\n")
    log = od.read_log(file, OWN)
    np.testing.assert_allclose(log.samples.y, [[31.5, np.deg2rad(20)], [28.2, np.deg2rad(21)]])


@pytest.mark.parametrize(
    ("noises", "said"),
    [
        ({"sonar": od.OutputNoise()}, "noises: unknown name|noises"),
        ({"magnetometer": od.OutputNoise(ca.SX.sym("p"))}, r"noises: sigma of 'magnetometer' = p contains the free symbol p"),
        ({"magnetometer": od.OutputNoise((1.0, 2.0))}, r"noises: sigma of 'magnetometer' has shape \(2, 1\): must be \(1, 1\)"),
        ({"gps": od.OutputNoise(1.0, x[:2])}, r"noises: gate of 'gps' has shape \(2, 1\): must be \(1, 1\)"),
        ({"heading": od.OutputNoise()}, "noises"),
    ],
)
def test_noises_that_do_not_fit_are_refused(noises: dict[str, od.OutputNoise], said: str):
    with pytest.raises(od.InputError, match=said):
        od.ControlAffineSystem(x, ("x", "y", "heading"), None, KNOWN, {}, OUTPUTS, noises=noises)


def test_numbers_that_make_no_sense_are_refused():
    for fields, said in (
        ({"sigma": 0.0}, r"^sigma is 0\.0: must be a finite number above 0"),
        ({"sigma": (1.0, -2.0)}, r"^sigma is -2\.0"),
        ({"detection": 1.5}, r"^detection is 1\.5: must be at most 1"),
        ({"correlation": 1.0}, r"^correlation is 1\.0"),
        ({"landmarks": ((1.0, np.nan),)}, "landmarks"),
    ):
        with pytest.raises(od.InputError, match=said):
            od.OutputNoise(**fields)
    with pytest.raises(od.InputError, match="noises: 'gps' is in sigmas, too"):
        od.ControlAffineSystem(x, OWN.names, None, KNOWN, {}, OUTPUTS, {"gps": 1.0}, noises=NOISES)

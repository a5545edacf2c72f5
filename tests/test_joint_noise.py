"""Noise correlated across sensors: what is accepted, and what a system with it is."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest

import obsdesign as od

R = np.array([[4.0, 1.0, 0.5], [1.0, 2.0, 0.0], [0.5, 0.0, 1.0]])
VEHICLE = od.Dubins(speed=10.0)
SENSORS = (od.Range((300.0, 0.0), sigma=1.0, name="left", inflation=2.0), od.GPS(sigma=3.0, name="right"), od.Magnetometer(sigma=0.1))


def system(joint: object = {("left", "right"): R}, sensors: tuple[object, ...] = SENSORS) -> od.System:
    return od.System(VEHICLE, sensors, joint_noise=joint)  # pyright: ignore[reportArgumentType]


def test_systems_with_equal_joint_noise_are_equal_and_travel():
    one, same, other = system(), system({("left", "right"): R.tolist()}), system({("left", "right"): 2 * R})
    assert one == same and hash(one) == hash(same) and one.model is same.model
    assert one != other and one != system({})
    assert pickle.loads(pickle.dumps(one)) == one
    R[0, 0] += 0.0  # a copy is kept: what the caller does to the array later changes nothing
    assert np.asarray(one.joint_noise["left", "right"]) == pytest.approx(R)


def test_the_model_has_the_covariance_of_one_instant():
    """R with the inflation of its sensors on rows and columns; the sensors of no group beside it."""
    covariance = np.zeros((4, 4))
    covariance[:3, :3] = R * np.outer([2, 1, 1], [2, 1, 1])
    covariance[3, 3] = 0.01
    model = system().model
    np.testing.assert_allclose(np.array(_numbers(model.instant_covariance)), covariance, rtol=1e-15)
    spread = np.concatenate([np.ravel(_numbers(each.noise.spread)) for each in model.channels])
    np.testing.assert_allclose(spread, np.sqrt([4.0, 2.0, 1.0, 0.01]), rtol=1e-15)
    drawn = spread[:, None] * model.correlation_root  # what the errors are made of, before inflation
    np.testing.assert_allclose(drawn @ drawn.T, covariance / np.outer([2, 1, 1, 1], [2, 1, 1, 1]), atol=1e-15)


def test_a_part_of_the_sensors_has_its_part_of_the_covariance():
    alone = system().model.only(("right", "magnetometer"))
    assert alone.joint[0].sensors == ("right",)
    np.testing.assert_allclose(_numbers(alone.instant_covariance), np.diag([2.0, 1.0, 0.01]), rtol=1e-15)
    assert system().model.only(("magnetometer",)).joint == ()


def _numbers(expression: ca.SX) -> np.ndarray:
    return ca.DM(expression).full()


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        ([("left", "right"), R], "must be a mapping"),
        ({"left": R}, "must be a tuple of two or more"),
        ({("left",): R}, "must be a tuple of two or more"),
        ({("left", 3): R}, "must be a tuple of two or more"),
        ({("left", "rihgt"): R}, "did you mean 'right'"),
        ({("left", "left"): np.eye(2)}, "'left' twice"),
        ({("left", "right"): R, ("right", "magnetometer"): np.eye(3)}, "'right' is in two groups"),
        ({("left", "right"): np.eye(2)}, r"has shape \(2, 2\): must be \(3, 3\)"),
        ({("left", "right"): np.full((3, 3), np.nan)}, r"\[0, 0\] is nan: must be finite"),
        ({("left", "right"): R + np.triu(np.ones((3, 3)), 1)}, "must be symmetric"),
        ({("left", "right"): np.ones((3, 3))}, "must be positive definite"),
        ({("left", "right"): -R}, "must be positive definite"),
        ({("left", "right"): "white"}, "must be an array of real numbers"),
    ],
)
def test_what_is_no_joint_noise_is_refused_by_name(joint: object, message: str):
    with pytest.raises(od.InputError, match=message):
        system(joint)


def test_a_sensor_whose_noise_is_not_one_covariance_is_refused_by_name():
    correlated = (od.Range((300.0, 0.0), sigma=1.0, name="left", correlation=0.5), *SENSORS[1:])
    with pytest.raises(od.InputError, match="'left' is correlated in time"):
        system(sensors=correlated)
    growing = (od.Range((300.0, 0.0), sigma=1.0, name="left", sigma_per_metre=0.5), *SENSORS[1:])
    with pytest.raises(od.InputError, match="'left' depends on the state"):
        system(sensors=growing).model  # noqa: B018  # the spread is known when the model is built

"""How many markers a vehicle needs: Belo, Salaris and Bicchi 2010, Proposition 1 and section IV-C; similarities of the plane."""

import pytest

import obsdesign as od

ALL = ("forward", "sideways", "turn_rate")


def test_three_markers_see_a_vehicle_under_any_inputs_and_two_do_not():
    # Proposition 1: three bearings give position and heading, whatever the inputs; two leave a circle through both markers. Section IV-C:
    # with three, the bearing of a target and how it changes give its place: rank 3 + 2
    found = od.landmark_needs(od.Omnidirectional(), unknown_inputs=ALL)
    assert [verdict.dimension for verdict in found.verdicts[0]] == [1, 2, 3]
    assert found.markers_needed == (3, 3)
    assert "3 markers: 3 of 3" in str(found)


@pytest.mark.parametrize("measures", [("bearing",), ("bearing", "range")])
def test_without_markers_the_similarities_of_the_plane_stay_hidden(measures):
    # constant unknown velocities along the vehicle's axes: what turns, shifts and, without ranges, scales all that is not marked moves no
    # output; with markers enough vehicle, velocities and targets are seen: rank 6 + 2 N, whatever the number N of targets
    constant = od.Polynomial(0)
    found = od.landmark_needs(od.Omnidirectional(), measures, unknown_inputs=ALL, targets=2, markers=3, disturbance=constant)
    assert [row[-1].dimension for row in found.verdicts] == [6, 8, 10]
    hidden = [verdict.null_space.shape[1] for verdict in found.verdicts[2]]
    assert hidden == ([4, 2, 0, 0] if measures == ("bearing",) else [3, 1, 0, 0])
    kinds = [symmetry.kind for symmetry in found.verdicts[2][1].symmetries]
    assert kinds == [od.SymmetryKind.ROTATION, od.SymmetryKind.SCALE][: hidden[1]]


def test_what_cannot_be_asked_is_refused():
    with pytest.raises(od.InputError, match="markers is 9"):
        od.landmark_needs(od.Omnidirectional(), markers=9)

"""Which axis of a take points up, for bodies that do not stand all the time, and sizes that are no person's."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.body_size import standing_root_m
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import TakeError
from perfanim.core.geometry import rotations as rot
from perfanim.core.labelling.human_size import check_human_size
from perfanim.core.labelling.take_import import import_take
from perfanim.core.labelling.up_axis import TURNS, axis_up
from perfanim.core.markers.marker_set import MarkerSet, load_marker_set
from perfanim.core.markers.marker_take import MarkerTake

SET = load_marker_set("cmu-41")
BODY = default_skeleton()
STAND = standing_root_m(BODY)


def markers(root_turn, place, hips=0.0):
    """Return the markers (M, 3) of a body that is turned, with its thighs bent forward."""
    pose = standing(BODY)
    pose[0] = rot.from_rotation_vector(np.array(root_turn))
    for side in "lr":
        femur = BODY.index(side + "femur")
        pose[femur] = rot.multiply(rot.from_rotation_vector(np.array([-hips, 0.0, 0.0])), pose[femur])
    return SET.positions_on(BODY, pose, place)


def take_of(*poses):
    """Return a take of poses, each for some frames."""
    rows = [np.tile(row, (count, 1, 1)) for row, count in poses]
    return MarkerTake("take", 30.0, SET.names, np.concatenate(rows))


UPRIGHT = markers((0.0, 0.0, 0.0), STAND)
LYING = markers((-np.pi / 2, 0.0, 0.0), (0.0, 0.12, 0.0))
SEATED = markers((0.0, 0.0, 0.0), (0.0, 0.1, 0.0), hips=np.pi / 2)
TAKES = {
    "lies down and gets up": take_of((UPRIGHT, 20), (LYING, 60), (UPRIGHT, 20)),
    "gets up": take_of((LYING, 60), (UPRIGHT, 30)),
    "sits on the floor": take_of((SEATED, 60)),
}


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("name", TAKES)
def test_bodies_that_do_not_stand_all_the_time(name, up):
    take = TAKES[name]
    assert axis_up(replace(take, positions_m=take.positions_m @ TURNS[up]), SET) == up


def test_a_body_that_is_upside_down_in_its_file_is_turned():
    stands = take_of((UPRIGHT, 10))
    for up in ("-y", "-z"):
        file = replace(stands, positions_m=stands.positions_m @ TURNS[up])
        assert axis_up(file, SET) == up
        np.testing.assert_allclose(import_take(file, SET, "auto").positions_m, stands.positions_m, atol=1e-12)


def test_sets_without_offsets_tell_the_axis_by_their_joints():
    bare = MarkerSet("bare", tuple(replace(marker, offset_m=None) for marker in SET.markers))
    stands = take_of((UPRIGHT, 10))
    for up in TURNS:
        assert axis_up(replace(stands, positions_m=stands.positions_m @ TURNS[up]), bare) == up


@pytest.mark.parametrize(
    ("factor", "size", "numbers", "called"),
    [
        (1e-3, "1.7 mm", "metres", "millimetres"),
        (1e3, "1.7 km", "millimetres", "metres"),
        (0.1, "17 cm", "centimetres", "millimetres"),
        (10.0, "17 m", "millimetres", "centimetres"),
        (1.0 / 25.4, "6.8 cm", "inches", "millimetres"),
    ],
)
def test_a_wrong_unit_is_named(factor, size, numbers, called):
    stands = take_of((UPRIGHT, 10))
    file = replace(stands, positions_m=factor * stands.positions_m)
    for up in ("auto", "y", None):
        with pytest.raises(TakeError, match=f"the body is {size} tall") as told:
            import_take(file, SET, up)
        assert f"the numbers seem to be {numbers}, the file calls them {called}" in str(told.value)
        assert told.value.advice == f"give {numbers} as its unit"


def test_children_giants_and_takes_without_a_torso_pass():
    stands = take_of((UPRIGHT, 10))
    for factor in (0.5, 1.5):
        check_human_size(replace(stands, positions_m=factor * stands.positions_m), SET)
    with pytest.raises(TakeError, match="tall; check its unit of length"):
        check_human_size(replace(stands, positions_m=4.0 * stands.positions_m), SET)
    hand = [i for i, marker in enumerate(SET.markers) if "hand" in marker.joint or "wrist" in marker.joint]
    names = tuple(SET.names[i] for i in hand)
    check_human_size(MarkerTake("hand", 30.0, names, 0.001 * stands.positions_m[:, hand]), SET)
    unseen = np.where(SET.torso[:, None], np.nan, 0.001 * stands.positions_m)
    check_human_size(replace(stands, positions_m=unseen), SET)

"""What is drawn of a followed person into a camera's picture."""

import numpy as np
import pytest
from filmed_people import POINTS, keypoints, moments, networks
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.blob_preview import reduced
from perfanim.core.vision.people.people_pipeline import PeoplePipeline
from perfanim.core.vision.people.person_preview import draw_person

GREEN, ORANGE, RED = (80, 255, 80), (60, 170, 255), (80, 80, 255)
WIDTH = 640
WRIST = POINTS.names.index("left_wrist")


@pytest.fixture
def drawn(truth):
    """drawn(change) -> the left camera's frame and picture, after a change of what the networks find."""
    rig, points_m = default_rig(), keypoints(truth)[:1]

    def draw(change):
        nets = networks(rig, points_m)
        change(nets)
        frame = PeoplePipeline(rig, nets).process(moments(rig, 1)[0])
        picture = np.zeros((480, WIDTH, 3), dtype=np.uint8)
        draw_person(frame, POINTS.names, 0, picture, WIDTH)
        return frame, picture

    return draw


def colour_at(frame, picture, point):
    x, y = reduced(frame.detected[0][point, :2].tolist(), picture, WIDTH)
    return tuple(picture[y, x].tolist())


def test_points_that_both_cameras_see_are_green_and_others_red(drawn):
    def move_wrist(nets):
        nets[0].pixels[0][WRIST, 1] -= 150.0

    frame, picture = drawn(move_wrist)
    assert colour_at(frame, picture, WRIST) == RED
    assert colour_at(frame, picture, POINTS.names.index("left_ankle")) == GREEN


def test_points_that_one_camera_sees_are_orange(drawn):
    frame, picture = drawn(lambda nets: nets[1].pixels.clear())
    assert {colour_at(frame, picture, point) for point in (WRIST, POINTS.names.index("right_ankle"))} == {ORANGE}


def test_the_limbs_of_the_sides_have_their_colours(drawn):
    frame, picture = drawn(lambda nets: None)
    for side, is_blue in (("left", True), ("right", False)):
        knee, ankle = (frame.detected[0][POINTS.names.index(f"{side}_{name}"), :2] for name in ("knee", "ankle"))
        x, y = reduced((0.5 * (knee + ankle)).tolist(), picture, WIDTH)
        blue, _, red = picture[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3).max(axis=0).tolist()
        assert (blue > red) == is_blue


def test_a_picture_of_nobody_says_so(drawn):
    frame, picture = drawn(lambda nets: nets[0].pixels.clear())
    assert len(frame.detected[0]) == 0
    assert picture[450:].any() and not picture[:450].any()

"""Sentences about doubtful passages: by limb, with frames and cause."""

from dataclasses import replace

import numpy as np
from perfanim.core.body.body_parts import PARTS
from perfanim.core.body.pose_notes import PoseNote
from perfanim.core.body.scene_pose import DOUBTFUL_PART_DEG, PerformerPose, PropPose, ScenePose
from perfanim.core.geometry import rotations as rot
from perfanim.core.session.doubtful_text import doubtful_text
from solved_poses import performer_pose

COUNT, FPS = 120, 60.0
HAND = PoseNote.uncertain("right hand", "its marker is hidden from both cameras")
LOST = PoseNote.of_text("waiting for the markers of the torso")


def take(doubtful: dict[int, PerformerPose] | None = None, *further: PerformerPose) -> list[ScenePose]:
    poses = {number: performer_pose(number) for number in range(COUNT)} | (doubtful or {})
    return [ScenePose((poses[number], *further), notes=poses[number].notes) for number in range(COUNT)]


def unsure(numbers: range) -> dict[int, PerformerPose]:
    """Poses with a doubtful right hand."""
    errors_deg = DOUBTFUL_PART_DEG + (np.array(list(PARTS)) == "right hand")
    return {n: replace(performer_pose(n), part_errors_deg=errors_deg, notes=(HAND,)) for n in numbers}


def told(poses: list[ScenePose], performers: tuple[str, ...] = ("Anna",), props: tuple[str, ...] = ()) -> str:
    return doubtful_text(poses, performers, props, 1.0 + np.arange(COUNT))


def test_limb_frames_and_cause_are_told() -> None:
    assert told(take()) == ""
    assert told(take(unsure(range(39, 62)))) == ("right hand, frames 40 to 62 (its marker is hidden from both cameras)")


def test_passages_with_a_short_pause_are_one_and_short_ones_are_counted() -> None:
    flickering = unsure(range(10, 20)) | unsure(range(25, 40)) | unsure(range(90, 92))
    assert told(take(flickering)) == ("right hand, frames 11 to 40 (its marker is hidden from both cameras); 1 shorter")
    assert told(take(unsure(range(10, 12)))) == ""


def test_a_reason_that_all_passages_have_is_told_once() -> None:
    text = told(take(unsure(range(10, 20)) | unsure(range(60, 80))))
    reason = "each: its marker is hidden from both cameras"
    assert text == f"right hand, frames 11 to 20; right hand, frames 61 to 80 ({reason})"


def test_the_longest_passages_are_listed_in_order_of_time() -> None:
    numbers = [*range(8), *range(30, 38), *range(60, 68), *range(85, 92), *range(110, 119)]
    text = told(take({number: replace(performer_pose(number), confidence=0.1) for number in numbers}))
    assert text == (
        "whole body, frames 1 to 8; whole body, frames 31 to 38; whole body, frames 61 to 68; "
        "whole body, frames 111 to 119; 1 shorter"
    )


def test_targets_that_were_not_found_are_named() -> None:
    gone = performer_pose(0, confidence=0.0)
    assert told(take(None, gone), ("Anna", "Ben")) == "Ben was never found"
    late = {n: replace(performer_pose(n), confidence=0.0, notes=(LOST,)) for n in range(30)}
    waiting = PoseNote(LOST.kind, f"Ben: {LOST.text}")
    swapped = [
        ScenePose(pose.performers[::-1], notes=(PoseNote.hidden(["left hand"]), *[waiting] * (n < 30)))
        for n, pose in enumerate(take(late, performer_pose(0)))
    ]
    assert told(swapped, ("Anna", "Ben")) == "Ben: whole body, frames 1 to 30 (waiting for the markers of the torso)"
    hidden, seen = (PropPose(rot.identity(), np.zeros(3), seen=count) for count in (0, 5))
    sword = [replace(pose, props=(seen if n >= 103 else hidden,)) for n, pose in enumerate(take())]
    assert told(sword, props=("sword",)) == "sword, frames 1 to 103 (not found)"
    assert told([replace(pose, props=(hidden,)) for pose in take()], props=("sword",)) == "sword was never found"

from dataclasses import replace

import numpy as np
from perfanim.core.body.body_parts import PARTS
from perfanim.core.body.pose_notes import NoteKind, PoseNote
from perfanim.core.body.scene_pose import (
    DOUBTFUL,
    DOUBTFUL_PART_DEG,
    PerformerPose,
    ScenePose,
    body_confidence,
    decisions,
    doubtful_parts,
    doubtful_stretches,
    mean_part_confidences,
    part_confidences,
)

NONE = np.empty((0, 3))


def pose(time_s: float, confidence: float, *notes: str) -> PerformerPose:
    return PerformerPose(
        0,
        time_s,
        np.empty((0, 4)),
        np.zeros(3),
        confidence,
        NONE,
        NONE,
        np.empty(0),
        0.0,
        notes=tuple(map(PoseNote.of_text, notes)),
    )


def test_doubtful_stretches_have_times_and_the_most_frequent_reason() -> None:
    low = DOUBTFUL / 2
    poses = [
        pose(10.0, 0.9),
        pose(10.1, low, "left hand hidden"),
        pose(10.2, low, "left hand hidden", "right hand hidden"),
        pose(10.3, DOUBTFUL, "right hand hidden"),
        pose(10.5, low),
    ]
    found = doubtful_stretches(poses)
    assert [stretch.reason for stretch in found] == ["left hand hidden", ""]
    np.testing.assert_allclose([(s.start_s, s.stop_s) for s in found], [(0.1, 0.2), (0.5, 0.5)])


def test_what_holds_for_few_frames_is_not_the_reason_of_a_long_stretch() -> None:
    low = [pose(number / 30, 0.1, *["left hip hidden"] * (number < 5)) for number in range(30)]
    assert [stretch.reason for stretch in doubtful_stretches(low)] == [""]
    assert [stretch.reason for stretch in doubtful_stretches(low[:15])] == ["left hip hidden"]


def test_a_sure_take_has_no_doubtful_stretch() -> None:
    assert doubtful_stretches([]) == []
    assert doubtful_stretches([pose(0.0, 1.0), pose(1.0, DOUBTFUL)]) == []


def test_a_doubtful_part_has_stretches_of_its_own() -> None:
    """None where the whole pose is doubtful, and none for the other parts."""
    part, sure = "left arm", DOUBTFUL_PART_DEG
    unsure = sure + (np.array(list(PARTS)) == part)
    poses = [
        pose(0.0, 0.9),
        pose(0.1, 0.9, "right hand hidden", "left arm uncertain: its marker is hidden"),
        pose(0.2, 0.9, "right hand hidden"),
        pose(0.3, DOUBTFUL / 2, "right hand hidden"),
        pose(0.4, 0.9),
    ]
    errors = (np.empty(0), unsure, unsure, unsure, sure)
    poses = [replace(each, part_errors_deg=deg) for each, deg in zip(poses, errors, strict=True)]
    assert [each.doubtful_parts for each in poses] == [[], [part], [part], [part], []]
    whole, arm = doubtful_stretches(poses)
    assert (whole.part, whole.start_s, whole.stop_s, whole.reason) == ("", 0.3, 0.3, "right hand hidden")
    assert (arm.part, arm.start_s, arm.stop_s) == (part, 0.1, 0.2)
    assert arm.reason == "left arm uncertain: its marker is hidden"


def test_decisions_have_kind_reason_and_times() -> None:
    """What lasts, or pauses for a moment, is told once; problems that nothing was decided about are not told."""
    cut, led = (PoseNote.of(kind).text for kind in (NoteKind.CUT, NoteKind.PRIOR_LED))
    rows = [("left hand hidden",), (led,), (led, cut), (), (led, "left hand jumped, left out"), (), (), (), (led,)]
    poses = [pose(5.0 + 0.04 * number, 0.9, *notes) for number, notes in enumerate(rows)]
    found = decisions([ScenePose((each,), notes=each.notes) for each in poses])
    told = [(each.kind, each.first, each.last) for each in found]
    assert told == [("PRIOR_LED", 1, 4), ("CUT", 2, 2), ("JUMPED", 4, 4), ("PRIOR_LED", 8, 8)]
    assert found[1].reason == cut
    np.testing.assert_allclose([found[0].start_s, found[0].stop_s], [0.04, 0.16])
    assert decisions([]) == []


def test_a_decision_is_no_reason_for_doubt() -> None:
    led = PoseNote.of(NoteKind.PRIOR_LED).text
    assert [each.reason for each in doubtful_stretches([pose(0.1 * i, 0.1, led) for i in range(5)])] == [""]


def test_confidence_in_parts_is_doubtful_at_their_limits_and_the_bodys_is_the_geometric_mean() -> None:
    errors_deg = np.linspace(0.2, 1.4, len(PARTS)) * DOUBTFUL_PART_DEG
    parts = part_confidences(errors_deg)
    np.testing.assert_allclose(part_confidences(DOUBTFUL_PART_DEG), DOUBTFUL)
    np.testing.assert_allclose(part_confidences(np.zeros(len(PARTS))), 1.0)
    assert [part for part, known in zip(PARTS, parts, strict=True) if known < DOUBTFUL] == doubtful_parts(errors_deg)
    np.testing.assert_allclose(body_confidence(errors_deg), np.exp(np.log(parts).mean()))
    assert body_confidence(np.empty(0)) == 1.0


def test_confidence_follows_the_expected_errors_of_the_parts_and_keeps_what_lowered_it() -> None:
    errors_deg = 0.3 * DOUBTFUL_PART_DEG
    lowered = replace(pose(0.0, 0.8 * body_confidence(errors_deg)), part_errors_deg=errors_deg)
    np.testing.assert_allclose(lowered.part_confidences, 0.8 * part_confidences(errors_deg))
    worse_deg = np.where(np.arange(len(PARTS)) == 2, 2.0, 0.3) * DOUBTFUL_PART_DEG
    worse = lowered.with_part_errors(worse_deg)
    np.testing.assert_allclose(worse.confidence, 0.8 * body_confidence(worse_deg))
    assert worse.confidence < lowered.confidence
    assert worse.doubtful_parts == [list(PARTS)[2]]
    waiting = pose(0.1, 0.0)
    assert len(waiting.part_confidences) == 0
    assert mean_part_confidences([waiting]) == {}
    np.testing.assert_allclose(
        list(mean_part_confidences([lowered, waiting]).values()), 0.4 * part_confidences(errors_deg)
    )

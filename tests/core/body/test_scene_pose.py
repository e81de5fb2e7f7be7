import numpy as np
from perfanim.core.body.scene_pose import DOUBTFUL, PerformerPose, doubtful_stretches

NONE = np.empty((0, 3))


def pose(time_s: float, confidence: float, *notes: str) -> PerformerPose:
    return PerformerPose(
        0, time_s, np.empty((0, 4)), np.zeros(3), confidence, NONE, NONE, np.empty(0), 0.0, notes=notes
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


def test_a_sure_take_has_no_doubtful_stretch() -> None:
    assert doubtful_stretches([]) == []
    assert doubtful_stretches([pose(0.0, 1.0), pose(1.0, DOUBTFUL)]) == []

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry.camera import WORLD_FROM_CAMERA, Camera
from perfanim.core.labelling.labeller import Labeller
from perfanim.core.labelling.template_labelling import label_by_template
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import MarkerSet, load_marker_set

NOISE_M = 0.003
SQUARE_M = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.5, 0.5, 0.0]])


def markers_of(marker_set: MarkerSet, height_m: float = 1.75) -> np.ndarray:
    skeleton = default_skeleton(height_m)
    return marker_set.positions_on(skeleton, t_pose(skeleton))


def limbs(count: int) -> Labeller:
    """A labeller of markers none of which is on the torso."""
    return Labeller(np.zeros(count, dtype=bool))


def spread(count: int) -> np.ndarray:
    return np.tile(NOISE_M**2 * np.eye(3), (count, 1, 1))


def moving(template: np.ndarray, time_s: float) -> np.ndarray:
    """The markers in a walk at 1.5 m/s with arms and legs that swing."""
    points = template + np.array([1.5 * time_s - 1.0, 0.9, -3.0])
    points[::2, 2] += 0.25 * np.sin(2 * np.pi * time_s)
    points[1::2, 2] -= 0.25 * np.sin(2 * np.pi * time_s)
    return points


def test_markers_keep_their_labels_with_occlusion_and_ghosts():
    marker_set = load_marker_set("boxing")
    template = markers_of(marker_set)
    rng = np.random.default_rng(3)
    labeller = Labeller(marker_set.torso)
    start = moving(template, 0.0)
    labeller.begin(start, label_by_template(start, template))
    hidden = np.zeros(len(start), dtype=int)
    wrong = labelled = late = 0
    for frame in range(1, 180):
        truth = moving(template, frame / 60)
        hidden = np.maximum(hidden - 1, 0)
        hidden[(rng.random(len(hidden)) < 0.02) & (hidden == 0)] = 12  # each is away about a fifth of the time
        shown = np.flatnonzero(hidden == 0)
        ghosts = rng.uniform(truth.min(axis=0), truth.max(axis=0), (3, 3))
        points = np.concatenate((truth[shown] + rng.normal(0, NOISE_M, (len(shown), 3)), ghosts))
        order = rng.permutation(len(points))
        names = np.concatenate((shown, [-1, -1, -1]))[order]
        # the pose of the frame before, which explains the hidden markers too
        labels = labeller.label(points[order], spread(len(points)), moving(template, (frame - 1) / 60), 1 / 60)
        real = names >= 0
        wrong += int(np.sum((labels[real] != names[real]) & (labels[real] >= 0)))
        late += int(np.sum(labels[real] < 0))
        labelled += int(real.sum())
    assert wrong <= 0.005 * labelled
    assert late <= 0.005 * labelled


def two_cameras() -> list[Camera]:
    matrix = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
    places_m = [[-0.5, 0.9, 0.0], [0.5, 0.9, 0.0]]
    return [
        Camera(f"{place}", (640, 480), matrix, rotation=WORLD_FROM_CAMERA, translation_m=-WORLD_FROM_CAMERA @ place)
        for place in places_m
    ]


def test_blobs_are_labelled_in_each_image_and_single_ones_stay_rays():
    marker_set = load_marker_set("boxing")
    template = markers_of(marker_set)
    cameras = two_cameras()
    points = template + np.array([0.0, 0.9, -4.0])
    blobs = []
    for camera, shown in zip(cameras, (np.arange(9), np.arange(1, 9)[::-1]), strict=True):
        rows = np.tile([0.0, 0.0, 4.0, 200.0, 0.0], (len(shown), 1))
        rows[:, :2] = camera.project(points[shown])
        blobs.append(rows.astype(np.float32))
    frame = MarkerFrame(0, 0.0, blobs=tuple(blobs))
    labelled = limbs(len(marker_set)).label_blobs(frame, cameras, points + 0.01, 1 / 60)
    np.testing.assert_array_equal(labelled.blobs[:, 0], np.arange(9))
    np.testing.assert_array_equal(labelled.blobs[:, 1], [-1, 7, 6, 5, 4, 3, 2, 1, 0])
    np.testing.assert_array_equal(labelled.single_cameras, [0] + [-1] * 8)
    np.testing.assert_allclose(labelled.points_m[1:], points[1:], atol=1e-3)
    np.testing.assert_allclose(cameras[0].to_pixels(labelled.normalised[0, 0]), blobs[0][0, :2], atol=1e-3)


def followed(places_m: list[np.ndarray], elapsed_s: float = 1 / 60) -> np.ndarray:
    """Return which markers are sure after following places (M, 3) from labels that are certain."""
    labeller = limbs(len(places_m[0]))
    labels = np.arange(len(places_m[0]))
    labeller.begin(places_m[0], labels)
    labeller.confirm(np.ones(len(labels), dtype=bool))
    before = places_m[0]
    for points in places_m[1:]:
        seen = np.isfinite(points[:, 0])
        labeller.label(points[seen], spread(int(seen.sum())), before, elapsed_s)
        before = np.where(seen[: len(before), None], points[: len(before)], before)
    return labeller.is_confident


def test_only_confirmed_markers_are_confident() -> None:
    labeller = limbs(4)
    labeller.begin(SQUARE_M, np.array([0, 1, 2, -1]))
    labeller.confirm(np.array([True, False, True, True]))
    np.testing.assert_array_equal(labeller.is_confident, [True, False, True, False])  # the last is not seen


def test_unambiguously_tracked_markers_stay_confident() -> None:
    steps = [SQUARE_M + np.array([0.02 * frame, 0.0, 0.0]) for frame in range(4)]  # 1.2 m/s
    assert followed(steps).all()
    before = limbs(4)
    before.begin(SQUARE_M, np.arange(4))
    assert not before.is_confident.any()  # nobody has vouched for them


def test_markers_that_meet_jump_or_hide_lose_confidence() -> None:
    meeting = [SQUARE_M * [share, 1.0, 1.0] for share in (1.0, 0.92, 0.84, 0.76, 0.68)]  # 5 cm nearer in each frame
    assert followed(meeting).all()
    close = SQUARE_M * [0.1, 1.0, 1.0]  # 5 cm apart
    assert not followed([close, close]).any()
    stranger = np.concatenate((SQUARE_M, np.array([[0.05, 0.0, 0.0]])))
    np.testing.assert_array_equal(followed([SQUARE_M, stranger]), [False, True, True, True])
    jumped = SQUARE_M.copy()
    jumped[2] += [0.0, 0.07, 0.0]
    np.testing.assert_array_equal(followed([SQUARE_M, jumped]), [True, True, False, True])
    hidden = SQUARE_M.copy()
    hidden[3] = np.nan
    assert followed([SQUARE_M, hidden, SQUARE_M]).all()  # hidden for a thirtieth of a second
    np.testing.assert_array_equal(followed([SQUARE_M, *[hidden] * 6, SQUARE_M]), [True, True, True, False])


def test_cut_clears_the_confidence() -> None:
    cut = SQUARE_M + np.array([[0.0, 0.07, 0.0]] * 3 + [[0.0, 0.0, 0.0]])
    assert not followed([SQUARE_M, cut]).any()


def test_briefly_hidden_marker_is_extrapolated() -> None:
    """The pose, which a hidden marker does not hold, has left it meanwhile."""
    step = np.array([0.03, 0.0, 0.0])
    labeller = limbs(4)
    labeller.begin(SQUARE_M, np.arange(4))
    labeller.label(SQUARE_M + step, spread(4), SQUARE_M, 1 / 60)
    labeller.label((SQUARE_M + 2 * step)[:3], spread(3), SQUARE_M + step, 1 / 60)
    left = SQUARE_M + 2 * step
    left[3, 2] = 0.2
    np.testing.assert_array_equal(labeller.label(SQUARE_M + 3 * step, spread(4), left, 1 / 60), np.arange(4))


def test_frame_of_other_points_clears_the_confidence() -> None:
    assert not followed([SQUARE_M, SQUARE_M + 3.0]).any()


def test_hidden_marker_does_not_take_a_tracked_markers_point() -> None:
    body, labeller, step = SQUARE_M, limbs(4), np.array([5.0 / 60, 0.0, 0.0])
    labeller.begin(body, np.arange(4))
    for _ in range(12):  # a fifth of a second, after which the lost one may be 0.35 m away
        before, body = body, body + step
        assert labeller.label(body[:3], spread(3), before, 1 / 60).tolist() == [0, 1, 2]
    before, body = body.copy(), body + step
    # a point that is b's if the lost one takes b's own, as would be best if as few as possible were left over
    points = np.concatenate((body[:3], body[1:2] - [0.0, 0.072, 0.0]))
    before[3] = body[1] + [0.0, 0.295, 0.0]
    assert labeller.label(points, spread(4), before, 1 / 60).tolist() == [0, 1, 2, -1]


def frames_until_named(away_m: list[list[float]], thought_m: np.ndarray, blobs: bool = False) -> list[list[int]]:
    """Return the labels of four markers' points, then of further points, in frames after two were hidden for long.

    Args:
        away_m: places of the points that are there in all frames that follow.
        thought_m: (4, 3) where the markers should be.
    """
    labeller, cameras = Labeller(np.array([True, False, False, False])), two_cameras()
    labeller.begin(thought_m, np.arange(4))
    for _ in range(12):
        labeller.label(thought_m[:2], spread(2), thought_m, 1 / 60)
    points = np.concatenate((thought_m[:2], np.array(away_m)))
    found = []
    for _ in range(5):
        if blobs:
            rows = np.tile(np.float32([0.0, 0.0, 4.0, 200.0, 0.0]), (2, len(points), 1))
            for row, camera in zip(rows, cameras, strict=True):
                row[:, :2] = camera.project(points)
            both = np.tile(np.arange(len(points))[:, None], (1, 2))
            frame = MarkerFrame(0, 0.0, points, spread(len(points)), blobs=tuple(rows), point_blobs=both)
            named = labeller.label_blobs(frame, cameras, thought_m, 1 / 60).blobs
            assert np.array_equal(named[:, 0], named[:, 1])
            found.append(
                [named[:, 0].tolist().index(point) if point in named[:, 0] else -1 for point in range(len(points))]
            )
        else:
            found.append(labeller.label(points, spread(len(points)), thought_m, 1 / 60).tolist())
    return found


@pytest.mark.parametrize("blobs", [False, True])
def test_hidden_marker_takes_a_lasting_lone_point_far_away(blobs) -> None:
    """The body that hid it moved on without it."""
    thought_m = np.array([[0.0, 1.0, -4.0], [0.5, 1.0, -4.0], [0.0, 1.5, -4.0], [1.0, 2.4, -4.0]])
    near = [0.1, 0.9, -4.2]  # of the third: 0.64 m; it is 1.8 m from the fourth
    assert frames_until_named([near], thought_m, blobs) == [[0, 1, -1]] * 3 + [[0, 1, 2]] * 2
    either = thought_m.copy()
    either[3] = [0.2, 1.5, -4.0]
    assert frames_until_named([near], either, blobs) == [[0, 1, -1]] * 5  # the third's or the fourth's
    assert frames_until_named([near, [-0.1, 0.9, -4.0]], thought_m, blobs) == [[0, 1, -1, -1]] * 5  # which of the two?


def test_unseen_marker_has_a_wider_gate_than_a_tracked_one():
    """A third of a metre for a limb's; one that was seen in the frame before is not so far off a frame later."""
    marker_set = load_marker_set("boxing")
    body, hand = markers_of(marker_set), marker_set.names.index("LHAN")
    moved = body.copy()
    moved[hand] += np.array([0.0, 0.0, 0.3])
    for known in (False, True):
        shown = np.flatnonzero(known | (np.arange(len(body)) != hand))
        labeller = Labeller(marker_set.torso)
        labeller.begin(body[shown], shown)
        labeller.label(body[shown], spread(len(shown)), body, 1 / 30)
        assert labeller.label(moved, spread(len(body)), body, 1 / 30)[hand] == (-1 if known else hand)

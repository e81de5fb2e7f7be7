import numpy as np
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.blob_preview import draw_blobs, draw_labels
from perfanim.core.vision.calibration.board_preview import draw_corners, draw_coverage, draw_taken, draw_wanted
from perfanim.core.vision.calibration.calibration_board import BoardView

PICTURE = (240, 320, 3)


def dominant(picture: np.ndarray, x: float, y: float, reach: int = 8) -> str:
    """The colour that stands out about a place of a picture that was black."""
    around = picture[round(y) - reach : round(y) + reach + 1, round(x) - reach : round(x) + reach + 1].astype(int)
    blue, green, red = around.reshape(-1, 3).max(axis=0)
    if max(blue, green, red) == 0:
        return "nothing"
    return "orange" if red > 200 and 120 < green < 220 else "green" if green > red else "red"


def test_rings_show_the_use_of_blobs():
    # in an image of twice the picture's width: seen by both, by the second camera alone, by mistake
    places = [(100.5, 80.5), (300.5, 200.5), (500.5, 400.5)]
    blobs = np.array([(x, y, 3.0, 200.0, 0.0) for x, y in places], np.float32)
    frame = MarkerFrame(
        0,
        0.0,
        points_m=np.zeros((1, 3)),
        covariances_m2=np.eye(3)[None],
        blobs=(blobs[:1], blobs),
        point_blobs=np.array([[0, 0]]),
        single_cameras=np.array([1]),
        single_blobs=np.array([1]),
        single_points=np.zeros((1, 2)),
    )
    left, right = np.zeros(PICTURE, np.uint8), np.zeros(PICTURE, np.uint8)
    rig = default_rig()
    draw_blobs(frame, (38.4, 52.0), rig, 0, left, 640)
    draw_blobs(frame, (38.4, 52.0), rig, 1, right, 640)
    assert [dominant(right, x / 2, y / 2) for x, y in places] == ["green", "orange", "red"]
    assert dominant(left, 50.25, 40.25) == "green"
    # what the second camera sees alone, in the middle of its image, is somewhere along a line in the first's
    for distance_m in (1.5, 3.0, 6.0):
        camera = rig.cameras[1]
        x, y = rig.cameras[0].project(camera.centre_m + distance_m * camera.rays(np.zeros(2)))
        if 0.0 < x < 640.0 and 0.0 < y < 480.0:
            assert dominant(left, x / 2, y / 2, reach=2) != "nothing"
            assert dominant(left, x / 2, y / 2 + 12.0, reach=4) == "nothing"


def test_marker_names_are_drawn_at_the_markers():
    rig = default_rig()
    markers = np.array([[0.3, 1.2, 0.0], [-0.3, 0.6, 0.2], [0.0, 1.0, 50.0]])  # the last is behind the cameras
    pictures = np.zeros((240, 640, 3), np.uint8)
    named = draw_labels(("LSHO", "RHAN", "HEAD"), markers, np.array([True, False, True]), rig, pictures)
    assert not pictures.any()
    for number, camera in enumerate(rig.cameras):
        picture = named[:, number * 320 : (number + 1) * 320]
        for marker, (least, most) in ((0, (180, 255)), (1, (60, 150))):
            x, y = camera.project(markers[marker]) / 2.0
            around = picture[round(y) - 14 : round(y) + 2, round(x) : round(x) + 40]
            assert least < around.max() <= most
            picture[round(y) - 16 : round(y) + 4, round(x) : round(x) + 50] = 0
        assert not picture.any()


def test_preview_shows_board_coverage_and_wanted_region():
    grey = np.full(PICTURE, 90, np.uint8)
    picture = grey.copy()
    covered = np.zeros((18, 24), bool)
    covered[:9, :12] = True
    draw_coverage(picture, covered)
    assert (picture[:120, :160, 1] > picture[:120, :160, 2]).all()
    np.testing.assert_array_equal(picture[120:], grey[120:])
    np.testing.assert_array_equal(picture[:, 160:], grey[:, 160:])

    picture = grey.copy()
    draw_corners(picture, BoardView(np.arange(1), np.array([[200.5, 100.5]])), 640)
    assert np.argwhere((picture != grey).any(axis=2)).mean(axis=0).round().tolist() == [50.0, 100.0]

    picture = grey.copy()
    draw_wanted(picture, (2, 0))
    changed = np.argwhere((picture != grey).any(axis=2))
    assert changed.min(axis=0).tolist() >= [160, 0] and changed.max(axis=0).tolist() <= [239, 106]
    assert len(changed) > 500

    draw_taken(picture)
    assert (picture[:2, :, 1] > 200).all() and (picture[:, -2:, 1] > 200).all()

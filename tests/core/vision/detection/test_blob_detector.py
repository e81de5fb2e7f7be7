import cv2
import numpy as np
import pytest
from perfanim.core.errors import CaptureError, SettingsError
from perfanim.core.vision.detection.background import BackgroundLearner, background_from_take, learn_backgrounds
from perfanim.core.vision.detection.blob_detector import DetectionSettings, Detector, _parts


def grid(seed: int, count: int = 12) -> np.ndarray:
    """Centres at least 100 px apart, at random sub-pixel places."""
    cells = np.stack(np.meshgrid(80 + 140 * np.arange(4), 90 + 140 * np.arange(3)), axis=-1).reshape(-1, 2)[:count]
    return cells + np.random.default_rng(seed).uniform(-20, 20, (count, 2))


def learned_background(images):
    """The background of one camera."""
    return learn_backgrounds((image,) for image in images)[0]


def matched(blobs: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Blobs in the order of the centres that they are nearest to."""
    distance = np.linalg.norm(centres[:, None] - blobs[None, :, :2], axis=2)
    return blobs[distance.argmin(axis=1)]


@pytest.mark.parametrize("radius", [2.0, 3.0, 5.5])
def test_centres_are_exact_with_noise_of_two_grey_levels(draw, radius):
    background = learned_background(draw(np.empty((0, 2)), radius, seed=100 + i) for i in range(20))
    detector = Detector(background)
    errors = []
    for seed in range(6):
        centres = grid(seed)
        blobs = detector.detect(draw(centres, radius, seed=seed))
        assert len(blobs) == len(centres)
        found = matched(blobs, centres)
        errors.append(found[:, :2] - centres)
        assert np.abs(found[:, 2] - radius).max() < 0.15
    errors = np.concatenate(errors)
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) <= 0.012
    assert np.abs(errors.mean(axis=0)).max() < 0.004  # no bias towards any side: pixel centres are at whole numbers


def test_background_mean_and_deviation_are_those_of_every_pixel_and_channel(draw):
    shade = np.zeros((480, 640, 3)) + np.linspace(10, 90, 640)[None, :, None] * [1.0, 0.5, 0.2]
    learned = learned_background(draw(np.empty((0, 2)), 1, background=shade, noise=3.0, seed=i) for i in range(40))
    # the mean of 40 frames is known to 3 / sqrt(40), a deviation to 3 / sqrt(80); five sigmas over all pixels
    assert np.abs(learned.mean - shade).mean() < 0.6
    assert np.abs(learned.mean - shade).max() < 5 * 3 / np.sqrt(40)
    assert abs(np.median(learned.deviation) - 3.0) < 0.1


def whole_foreground(detector, image):
    part, left = detector.foreground(image)
    mask = np.zeros(image.shape[:2], dtype=np.uint8)
    mask[:, left : left + part.shape[1]] = part
    return mask


def test_foreground_has_only_the_columns_that_changed(draw):
    quiet = learned_background(draw(np.empty((0, 2)), 1, noise=0.0) for _ in range(3))
    image = draw(np.empty((0, 2)), 1, noise=0.0)
    detector = Detector(quiet)
    mask, _ = detector.foreground(image)
    assert mask.shape == (480, 0) and len(detector.detect(image)) == 0
    image[100, 0] = image[200, 9] = 200
    mask, left = detector.foreground(image)
    assert mask.shape == (480, 11) and left == 0
    image[100, 639] = 200
    assert detector.foreground(image)[0].shape == (480, 640)


def test_foreground_is_where_any_channel_differs_by_more_than_the_threshold(draw):
    quiet = learned_background(draw(np.empty((0, 2)), 1, noise=0.0) for _ in range(3))
    detector = Detector(quiet, DetectionSettings(threshold=30.0, dilation_px=0))
    image = draw(np.empty((0, 2)), 1, noise=0.0)
    image[100, 200] = (20, 20, 51)
    image[110, 200] = (20, 20, 50)
    image[120, 200] = (20, 51, 20)
    mask = whole_foreground(detector, image)
    assert mask[100, 200] == 255 and mask[120, 200] == 255
    assert mask.sum() == 2 * 255
    dilated = whole_foreground(Detector(quiet, DetectionSettings(threshold=30.0, dilation_px=1)), image)
    assert dilated[99:102, 199:202].all() and dilated.sum() == 18 * 255


def test_foreground_is_also_what_is_darker_than_the_background(draw):
    lit = np.zeros((480, 640, 3)) + 200.0
    quiet = learned_background(draw(np.empty((0, 2)), 1, background=lit, noise=0.0) for _ in range(3))
    image = draw(np.empty((0, 2)), 1, background=lit, noise=0.0)
    image[100, 200] = (200, 169, 200)
    image[110, 200] = (200, 170, 230)
    image[120, 200] = (0, 200, 200)
    mask = whole_foreground(Detector(quiet, DetectionSettings(threshold=30.0, dilation_px=0)), image)
    assert mask[100, 200] == 255 and mask[120, 200] == 255
    assert mask.sum() == 2 * 255


def test_blobs_are_measured_independently(draw):
    centres = grid(8, 6)
    images = [draw(centres[i : i + 1], 2.0 + i, noise=0.0, background=0.0) for i in range(len(centres))]
    blobs = Detector().detect(np.maximum.reduce(images))
    alone = np.concatenate([Detector().detect(image) for image in images])
    assert len(blobs) == len(alone) == len(centres)
    np.testing.assert_array_equal(matched(blobs, centres), matched(alone, centres))


def test_noisy_pixels_have_a_wider_band(draw):
    rng = np.random.default_rng(4)
    learner = BackgroundLearner()
    for i in range(50):
        image = draw(np.empty((0, 2)), 1, noise=1.0, seed=i)
        image[200:220, 300:320] = np.clip(60 + rng.normal(0, 25, (20, 20, 3)), 0, 255)  # a flickering lamp
        learner.add(image)
    image = draw(np.empty((0, 2)), 1, noise=1.0, seed=99)
    image[200:220, 300:320] = 110  # two of its deviations
    assert len(Detector(learner.result()).detect(image)) == 0


def test_background_is_learned_behind_markers_that_move(draw):
    samples = [draw(np.array([[50.0 + 18 * i, 200.0], [300.0, 60.0 + 12 * i]]), 5, seed=i) for i in range(25)]
    background = background_from_take(samples)
    assert np.abs(background.mean - 20.0).max() < 6.0
    blobs = Detector(background).detect(samples[7])
    assert len(blobs) == 2


def test_markers_beside_fixed_lamps_are_found(draw):
    lamps = np.array([[100.0, 100.0], [400.0, 300.0]])
    empty = learned_background(draw(lamps, 6, level=250, seed=i) for i in range(10))
    marker = np.array([[120.0, 100.0]])
    blobs = Detector(empty).detect(draw(np.concatenate((lamps, marker)), 4, level=250, seed=50))
    near = np.linalg.norm(blobs[:, :2] - marker, axis=1)
    assert near.min() < 0.1


def test_markers_at_ignored_places_are_left_out(draw):
    centres = grid(3)
    image = draw(centres, 3.0)
    ignored = centres[[2, 7]] + 1.0
    blobs = Detector(ignored_px=ignored).detect(image)
    everywhere = Detector().detect(image)
    kept = np.linalg.norm(everywhere[:, None, :2] - ignored, axis=2).min(axis=1) > 3.0
    assert kept.sum() == len(centres) - 2
    np.testing.assert_array_equal(blobs, everywhere[kept])
    passing = draw(ignored[:1] + np.array([5.0, 0.0]), 3.0)  # a marker is lost within 1 % of the width
    assert len(Detector(ignored_px=ignored).detect(passing)) == 0
    assert len(Detector(ignored_px=ignored).detect(draw(ignored[:1] + np.array([8.0, 0.0]), 3.0))) == 1


def test_touching_markers_are_split(draw):
    centres = np.array([[200.0, 200.0], [209.6, 200.4], [400.0, 100.0], [404.0, 107.5]])
    blobs = Detector().detect(draw(centres, 5, background=2.0))
    found = matched(blobs, centres)
    assert len(blobs) == 4
    assert np.abs(found[:, :2] - centres).max() < 0.8


def test_blob_numbers_have_64_bits(draw):
    """NumPy 2 does not widen 16 bits by itself: bodies are numbered in the upper bits."""
    image = draw(np.array([[300.0, 200.0]]), 3.0, background=5.0)
    image[120:320, 250:350] = np.maximum(image[120:320, 250:350], 60)
    detector = Detector()
    parts = _parts(*detector.foreground(image), detector.settings)
    spots = detector._spots(image, None, max(parts, key=lambda part: part.inside.size), 5.0)
    assert len(spots.owner) > 0
    assert spots.owner.dtype == np.int64


def test_streaks_and_specks_are_rejected(draw):
    centres = grid(3, 6)
    image = draw(centres, 4, background=5.0)
    image[300:303, 50:150] = 220  # a bright edge
    image[400, 500] = 255  # one hot pixel
    blobs = Detector().detect(image)
    assert len(blobs) == 6


def test_threshold_adapts_to_dim_and_bright_cameras(draw):
    centres = grid(5, 8)
    for level in (50.0, 240.0):
        image = draw(centres, 4, level=level, background=3.0)
        glint = draw(np.array([[600.0, 450.0]]), 3, level=0.25 * level, background=3.0, noise=0.0)
        blobs = Detector().detect(np.maximum(image, glint))
        assert len(blobs) == 8


@pytest.mark.parametrize("wall", [90, 140])
@pytest.mark.parametrize("colour", [(30, 30, 220), (220, 60, 30), (40, 200, 40), (30, 200, 220), (200, 40, 200)])
def test_coloured_markers_are_found_in_front_of_any_wall(draw, wall, colour):
    centres = np.array([[100.3, 80.6], [300.5, 200.2], [510.7, 90.1], [200.9, 400.4]])
    empty = learn_backgrounds((draw(np.empty((0, 2)), 1, background=wall, seed=number),) for number in range(6))[0]
    blobs = Detector(empty).detect(draw(centres, 3.0, level=np.array(colour, float), background=wall, seed=99))
    assert len(blobs) == len(centres)
    apart = np.linalg.norm(blobs[:, None, :2] - centres, axis=2).min(axis=0)
    # 0.012 px is asked for at a contrast of 180 grey levels; the green marker rises 60 above the brightest wall
    assert np.sqrt(np.mean(apart**2)) < 0.012 * 180 / 60


def test_hue_and_brightness_are_those_of_the_marker(draw):
    background = np.zeros(3)
    red = Detector().detect(
        draw(np.array([[100.0, 100.0]]), 5, level=np.array([20.0, 20.0, 220.0]), background=background)
    )
    blue = Detector().detect(
        draw(np.array([[100.0, 100.0]]), 5, level=np.array([220.0, 20.0, 20.0]), background=background)
    )
    assert min(red[0, 4], 180 - red[0, 4]) < 3
    assert abs(blue[0, 4] - 120) < 3
    assert abs(red[0, 3] - 220) < 4


def test_images_of_another_size_than_the_background_are_refused(draw):
    background = learned_background(draw(np.empty((0, 2)), 1, seed=i) for i in range(2))
    with pytest.raises(CaptureError, match="320x240"):
        Detector(background).detect(np.zeros((240, 320, 3), np.uint8))
    with pytest.raises(CaptureError, match="without the performer"):
        learned_background([])
    with pytest.raises(SettingsError, match="threshold"):
        DetectionSettings(threshold=0.0)


def large_room(centres, seed):
    """An image of 1280x720 with a clothed body that hides the left of a lit room, and discs."""
    image = np.full((720, 1280, 3), 60.0)
    image[200:600, 400:520] = 110.0
    for x, y in centres:
        rows, columns = np.mgrid[int(y) - 9 : int(y) + 10, int(x) - 9 : int(x) + 10]
        cover = np.clip(5.5 - np.hypot(rows - y, columns - x), 0.0, 1.0)[..., None]
        patch = image[int(y) - 9 : int(y) + 10, int(x) - 9 : int(x) + 10]
        patch[:] = patch * (1.0 - cover) + 235.0 * cover
    noise = np.random.default_rng(seed).normal(0.0, 2.0, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def test_search_in_a_part_of_a_large_image_finds_the_same_markers():
    room = np.full((720, 1280, 3), 60.0)
    rng = np.random.default_rng(0)
    empty = learned_background(
        np.clip(np.rint(room + rng.normal(0.0, 2.0, room.shape)), 0, 255).astype(np.uint8) for _ in range(8)
    )
    whole, partly = Detector(empty), Detector(empty, DetectionSettings(whole_every=4))
    start = np.array([[450.0, 250.0], [470.0, 400.0], [440.0, 560.0], [620.0, 330.0], [330.0, 340.0]])
    late = []
    for number in range(14):
        # fast, and from number 6 on one more comes into sight far away
        centres = start + number * np.array([[1.0, 2.0], [0.0, -1.0], [3.0, 0.0], [25.0, -6.0], [-12.0, 5.0]])
        centres = np.concatenate((centres, [[1150.0, 120.0 + number]])) if number >= 6 else centres
        image = large_room(centres, number)
        expected, found = whole.detect(image), partly.detect(image)
        if number >= 6 and len(found) < len(expected):
            late.append(number)
            expected = expected[expected[:, 0] < 1100.0]
        np.testing.assert_allclose(found, matched(expected, found[:, :2]), atol=0.01)
        assert len(found) == len(expected) == len(centres) - (number in late)
    assert 1 <= len(late) <= 3


def test_brightness_of_a_small_marker_does_not_depend_on_sub_pixel_place(draw):
    """A lens blurs it: it has four bright pixels and eight half as bright, or nine bright ones.

    On a body, markers dimmer than the others are taken for skin.
    """
    brightness = []
    for phase in np.stack(np.meshgrid(np.arange(0.0, 1.0, 0.125), [0.0, 0.5]), axis=-1).reshape(-1, 2):
        image = cv2.GaussianBlur(draw(np.array([[320.0, 250.0]]) + phase, 1.2, level=240.0), (0, 0), 0.5)
        (blob,) = Detector().detect(image)
        brightness.append(blob[3])
    assert min(brightness) > 0.9 * max(brightness)

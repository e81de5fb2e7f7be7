"""Simulated studios with one fault or none, for practice and for testing the setup check.

Each has a random performer, light, exposure and marker set.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..body.standard_skeleton import DEFAULT_HEIGHT_M, default_skeleton
from ..geometry import rotations as rot
from ..geometry.arrays import Image
from ..geometry.camera import CameraRig
from ..markers.marker_set import MarkerSet
from ..subjects.setup_check.finding import Fault
from ..vision.calibration.calibration_board import Board, BoardView
from ..vision.sources.image_set import ImageSet
from .calibrated_studio import views_of_board
from .studio.boards import DEFAULT_BOARD
from .studio.discs import draw_disc
from .studio.simulated_source import SimulatedSource, open_simulated

Generator = np.random.Generator
Change = Callable[[int, Image], Image]  # changes a camera's image; the number identifies the camera

FPS, SECONDS, EMPTY_FRAMES = 30.0, 6.0, 6


@dataclass(frozen=True)
class Studio:
    """Pictures taken in a studio, and the calibration that its user has made.

    Args:
        empty: Images of the empty room, by moment.
        moments: Images of the performer in a T pose, then moving.
        height_m: Height of the performer.
    """

    rig: CameraRig
    empty: Sequence[tuple[Image, ...]]
    moments: Sequence[ImageSet]
    marker_set: MarkerSet
    height_m: float


def studio_with(fault: Fault | None, rng: Generator) -> Studio:
    """Return a random studio with one fault of cameras, light or markers, or without faults."""
    return _FAULTS[fault](rng) if fault else _studio(rng)


def board_views(rng: Generator, small: bool) -> tuple[Board, dict[str, list[BoardView]]]:
    """Return a board, too small or large enough, and each camera's views of it."""
    square_m = rng.uniform(0.025, 0.035) if small else rng.uniform(0.07, 0.09)
    board = replace(DEFAULT_BOARD, square_m=square_m)
    views = views_of_board(_source(rng).renderer, board, 6)
    return board, {name: list(seen.values()) for name, seen in views.items()}


def _source(rng: Generator, **settings: float) -> SimulatedSource:
    """Return a random studio without faults except for the given settings."""
    studio = {
        "marker_radius_m": rng.uniform(0.010, 0.015),
        "marker_brightness": rng.uniform(170.0, 255.0),
        "lens_blur_px": rng.uniform(0.4, 0.8),
        "exposure_s": rng.uniform(0.0, 0.004),
        "noise_sigma": rng.uniform(1.0, 3.0),
        "light": rng.uniform(0.1, 0.5),
        "rolling_shutter_s": rng.uniform(0.0, 0.015),
        "light_drift": rng.uniform(0.0, 0.03),
        "clutter": bool(rng.random() < 0.7),
        "seed": int(rng.integers(1 << 30)),
    }
    return open_simulated(
        {
            "behaviour": str(rng.choice(("walking", "running", "hopping", "jumping"))),
            "seconds": 2.0,
            "mirrored": bool(rng.random() < 0.5),
            "height_m": rng.uniform(1.5, 1.95),
            "marker_set": str(rng.choice(("locomotion", "boxing"))),
            "fps": FPS,
            "studio": studio | settings,
        }
    )


def _studio(rng: Generator, **settings: float) -> Studio:
    return _film(_source(rng, **settings))


def _film(source: SimulatedSource) -> Studio:
    frames = (source.frame(number) for number in range(round(SECONDS * FPS)))
    moments = [ImageSet(frame.number, frame.times_s, frame.images) for frame in frames]
    usual = default_skeleton()
    size = np.linalg.norm(source.motion.skeleton.offsets_m) / np.linalg.norm(usual.offsets_m)
    empty, height_m = list(source.background_frames(EMPTY_FRAMES)), DEFAULT_HEIGHT_M * float(size)
    return Studio(source.rig, empty, moments, source.subject.marker_set, height_m)


def _change_images(studio: Studio, change: Change, with_empty: bool = True) -> Studio:
    def changed(images: tuple[Image, ...]) -> tuple[Image, ...]:
        return tuple(change(number, image) for number, image in enumerate(images))

    moments = [replace(moment, images=changed(moment.images)) for moment in studio.moments]
    return replace(studio, moments=moments, empty=list(map(changed, studio.empty)) if with_empty else studio.empty)


def _some_cameras(rng: Generator) -> set[int]:
    return ({0}, {1}, {0, 1})[int(rng.integers(3))]


def _dark(rng: Generator) -> Studio:
    return _studio(rng, marker_brightness=rng.uniform(15.0, 80.0), light=rng.uniform(0.02, 0.1))


def _bright(rng: Generator) -> Studio:
    gain, cameras = rng.uniform(4.0, 8.0), _some_cameras(rng)
    studio = _studio(rng, light=rng.uniform(0.5, 0.8))

    def change(number: int, image: Image) -> Image:
        return np.asarray(cv2.convertScaleAbs(image, alpha=gain)) if number in cameras else image

    return _change_images(studio, change)


def _blurred(rng: Generator) -> Studio:
    sigma_px, noise_sigma, cameras = rng.uniform(2.0, 4.0), rng.uniform(1.0, 3.0), _some_cameras(rng)

    def change(number: int, image: Image) -> Image:
        soft = cv2.GaussianBlur(image, (0, 0), sigma_px) if number in cameras else image
        noisy = soft + noise_sigma * rng.standard_normal(image.shape, dtype=np.float32)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    return _change_images(_studio(rng, noise_sigma=0.0), change)


def _slow_shutter(rng: Generator) -> Studio:
    return _studio(rng, exposure_s=rng.uniform(0.014, 0.03))


def _reflections(rng: Generator) -> Studio:
    cameras, radius_px = _some_cameras(rng), rng.uniform(1.5, 3.0)
    places = [rng.uniform((60.0, 60.0), (580.0, 420.0), (rng.integers(1, 4), 1, 2)) for _ in range(2)]

    def change(number: int, image: Image) -> Image:
        shown = image.copy()
        for place in places[number] if number in cameras else ():
            draw_disc(shown, place, radius_px, np.full(3, 235.0), 0.5)
        return shown

    return _change_images(_studio(rng), change, with_empty=False)


def _exchanged(rng: Generator) -> Studio:
    studio = _studio(rng)
    moments = [replace(moment, images=moment.images[::-1], times_s=moment.times_s[::-1]) for moment in studio.moments]
    return replace(studio, empty=[images[::-1] for images in studio.empty], moments=moments)


def _flipped(rng: Generator) -> Studio:
    """Mirror the images of some cameras, or turn them upside down."""
    code, cameras = int(rng.choice((1, -1))), _some_cameras(rng)

    def change(number: int, image: Image) -> Image:
        return np.asarray(cv2.flip(image, code)) if number in cameras else image

    return _change_images(_studio(rng), change)


def _bumped(rng: Generator) -> Studio:
    """Turn a camera by 1 to 3 degrees about a random axis after its calibration."""
    studio, index, axis = _studio(rng), int(rng.integers(2)), rng.normal(size=3)
    turn = np.radians(rng.uniform(1.0, 3.0)) * axis / np.linalg.norm(axis)
    cameras = list(studio.rig.cameras)
    rotation = rot.to_matrix(rot.from_rotation_vector(turn)) @ cameras[index].rotation
    translation_m = -rotation @ cameras[index].centre_m
    cameras[index] = replace(cameras[index], rotation=rotation, translation_m=translation_m)
    return replace(studio, rig=replace(studio.rig, cameras=tuple(cameras)))


def _moved(rng: Generator, towards_m: float) -> Studio:
    source, shift_m = _source(rng), np.array([0.0, 0.0, towards_m])
    old = source.performance
    starts_m, ends_m, markers_m = (positions + shift_m for positions in (old.starts_m, old.ends_m, old.markers_m))
    return _film(replace(source, performance=replace(old, starts_m=starts_m, ends_m=ends_m, markers_m=markers_m)))


def _wrong_square(rng: Generator) -> Studio:
    studio = _studio(rng)
    size = rng.uniform(0.6, 0.82) if rng.random() < 0.5 else rng.uniform(1.2, 1.6)
    cameras = tuple(replace(camera, translation_m=size * camera.translation_m) for camera in studio.rig.cameras)
    return replace(studio, rig=replace(studio.rig, cameras=cameras))


def _without_marker(rng: Generator) -> Studio:
    source = _source(rng)
    old, lost = source.performance, int(rng.integers(len(source.performance.marker_names)))
    names = (*old.marker_names[:lost], *old.marker_names[lost + 1 :])
    worn = replace(old, marker_names=names, markers_m=np.delete(old.markers_m, lost, axis=1))
    return _film(replace(source, performance=worn))


_FAULTS: dict[Fault, Callable[[Generator], Studio]] = {
    Fault.DARK: _dark,
    Fault.BRIGHT: _bright,
    Fault.BLURRED: _blurred,
    Fault.SHUTTER: _slow_shutter,
    Fault.REFLECTION: _reflections,
    Fault.EXCHANGED: _exchanged,
    Fault.BUMPED: _bumped,
    Fault.CLOSE: lambda rng: _moved(rng, rng.uniform(1.2, 1.6)),
    Fault.FAR: lambda rng: _moved(rng, -rng.uniform(3.0, 5.0)),
    Fault.SQUARE_SIZE: _wrong_square,
    Fault.MARKER_MISSING: _without_marker,
    Fault.FLIPPED: _flipped,
}
STUDIO_FAULTS = tuple(_FAULTS)

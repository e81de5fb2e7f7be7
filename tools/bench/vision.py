"""Errors of detection and triangulation with simulated cameras; for labels, `robustness` films takes."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from perfanim.core.geometry.arrays import Array, Image
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.geometry.rigid_transform import kabsch
from perfanim.core.simulate.calibrated_studio import calibrate_studio
from perfanim.core.simulate.shipped_performance import DEMO, performance
from perfanim.core.simulate.studio.discs import draw_disc
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import simulated_source
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.studio_settings import StudioSettings
from perfanim.core.vision.detection.blob_detector import Detector
from perfanim.core.vision.pipeline import MarkerPipeline
from perfanim.core.vision.sources.image_set import ImageSet

from .end_to_end import EXPOSURE_S
from .run import Run
from .solving import MARKER_SET

_NOISE = 2.0  # grey levels
_DARK, _BRIGHT = 16.0, 220.0
_BLUR_PX = 0.5
_RADII_PX = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
_SIDE = 8  # rows and columns of discs in an image
_DISC_IMAGES = 12
_MARKER_M = 0.0125
_BASELINE_M, _DISTANCE_M = 2.0, 3.0
_SPEEDS_M_S = (0.0, 1.0, 5.0)
_FPS = 60.0
_RUNS, _RUN_FRAMES, _RUN_MARKERS = 60, 10, 8
_SAME_M = 0.05  # largest distance of a point from the true marker that it shows


def vision(run: Run) -> dict[str, Any]:
    """Measure centres and points on simulated images, and write the figures.

    Returns:
        centroids (radius_px, rms_px per coordinate), points (speed_m_s, rms_mm of the distance, found), outputs.
    """
    run.progress(0.0, "centres of discs")
    centroids = [centroid_row(radius) for radius in _RADII_PX]
    run.progress(0.2, "points in space")
    true = _rig()
    source = simulated_source(performance(DEMO), MARKER_SET, Renderer(true, StudioSettings(noise_sigma=_NOISE)))
    rig = in_world_of(calibrate_studio(source).rig, true)
    points = [_points_row(speed, true, rig) for speed in _SPEEDS_M_S]
    figures: dict[str, Any] = {"centroids": centroids, "points": points}
    return run.write("vision", figures, figures)


def centroid_row(radius_px: float) -> dict[str, float]:
    """Return the coordinate error and the share found for discs (radius in pixels) with noise."""
    rng, detector = np.random.default_rng(7), Detector()
    errors = []
    for _ in range(_DISC_IMAGES):
        grid = 40.0 + 50.0 * np.stack(np.meshgrid(np.arange(_SIDE), np.arange(_SIDE)), axis=-1).reshape(-1, 2)
        centres = grid + rng.uniform(-5.0, 5.0, grid.shape)
        image = np.full((480, 640, 3), _DARK, dtype=np.uint8)
        for centre in centres:
            draw_disc(image, centre[None], radius_px, np.full(3, _BRIGHT), _BLUR_PX)
        found = detector.detect(noisy(image, rng))[:, :2].astype(np.float64)
        hits, targets = _nearest(found, centres, 1.0)
        errors.append(hits - targets)
    every = np.concatenate(errors)
    found_share = len(every) / (_DISC_IMAGES * _SIDE * _SIDE)
    return {"radius_px": radius_px, "rms_px": float(np.sqrt(np.mean(every**2))), "found": found_share}


def _nearest(found: Array, true: Array, most: float) -> tuple[Array, Array]:
    """Return the found points within a distance of a true one, and the nearest true ones."""
    apart = np.linalg.norm(found[:, None] - true[None], axis=-1)
    near = apart.argmin(axis=1)
    hits = apart[np.arange(len(found)), near] < most
    return found[hits], true[near[hits]]


def noisy(image: NDArray[Any], rng: np.random.Generator) -> Image:
    """Return an image with a camera's noise."""
    return np.asarray(np.clip(np.rint(image + rng.normal(0.0, _NOISE, image.shape)), 0, 255), dtype=np.uint8)


def _rig() -> CameraRig:
    """Return two default cameras, 2 m apart and 3 m from the performer."""
    scale = _BASELINE_M / default_rig().baseline_m()
    cameras = []
    for camera in default_rig().cameras:
        centre = camera.centre_m * np.array([scale, 1.0, 1.0])
        centre[2] *= np.sqrt(_DISTANCE_M**2 - (0.5 * _BASELINE_M) ** 2) / centre[2]
        cameras.append(replace(camera, translation_m=-camera.rotation @ centre))
    return CameraRig(tuple(cameras))


def in_world_of(rig: CameraRig, true: CameraRig) -> CameraRig:
    """Return the calibrated rig, moved so that its first camera is where the true one is."""
    turn = true.cameras[0].rotation.T @ rig.cameras[0].rotation
    centre = rig.cameras[0].centre_m
    moved: list[Camera] = []
    for camera in rig.cameras:
        place = turn @ (camera.centre_m - centre) + true.cameras[0].centre_m
        rotation = camera.rotation @ turn.T
        moved.append(replace(camera, rotation=rotation, translation_m=-rotation @ place))
    return CameraRig(tuple(moved))


def _points_row(speed_m_s: float, true: CameraRig, rig: CameraRig) -> dict[str, float]:
    """Locate markers that cross the capture space at some speed."""
    rng = np.random.default_rng(11)
    pairs: list[tuple[Array, Array]] = []
    for _ in range(_RUNS):
        pipeline = MarkerPipeline(rig)
        start = rng.uniform((-0.6, 0.5, -0.5), (0.6, 1.6, 0.5), (_RUN_MARKERS, 3))
        heading = rng.normal(size=3)
        velocity = speed_m_s * heading / np.linalg.norm(heading)
        for frame in range(_RUN_FRAMES):
            times = (frame - 0.5 * _RUN_FRAMES) / _FPS + EXPOSURE_S * (np.arange(9) / 8 - 0.5)
            path = start[:, None] + velocity * times[:, None]
            images = tuple(_film(camera, path, rng) for camera in true.cameras)
            points = pipeline.process(ImageSet(frame, (frame / _FPS,) * len(images), images)).points_m
            if len(points):
                pairs.append(_nearest(points, path[:, 4], _SAME_M))
    measured, truth = (np.concatenate(column) for column in zip(*pairs, strict=True))
    errors = np.linalg.norm(measured - truth, axis=1)
    turn, shift = kabsch(measured, truth)
    left = np.linalg.norm(measured @ turn.T + shift - truth, axis=1)
    return {
        "speed_m_s": speed_m_s,
        "rms_mm": 1e3 * float(np.sqrt(np.mean(errors**2))),
        "rms_mm_after_rigid_fit": 1e3 * float(np.sqrt(np.mean(left**2))),
        "p99_mm": 1e3 * float(np.percentile(errors, 99)),
        "found": len(errors) / (_RUNS * _RUN_FRAMES * _RUN_MARKERS),
    }


def _film(camera: Camera, path: Array, rng: np.random.Generator) -> Image:
    """Return an image of markers (M, 3) moving along paths (M, S, 3) while exposed."""
    width, height = camera.image_size
    image = np.full((height, width, 3), _DARK, dtype=np.uint8)
    depth = camera.to_camera(path.mean(axis=1))[:, 2]
    for marker in np.argsort(-depth):
        radius = camera.focal_px * _MARKER_M / float(depth[marker])
        draw_disc(image, camera.project(path[marker]), radius, np.full(3, _BRIGHT), _BLUR_PX)
    return noisy(image, rng)

"""Errors of detection, triangulation and labelling against simulated cameras."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.database.build_database import build_database
from perfanim.core.database.store import Database, open_database
from perfanim.core.geometry.arrays import Array, Image
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.geometry.rigid_transform import kabsch
from perfanim.core.session.session import Session
from perfanim.core.simulate.calibrated_studio import calibrate_studio
from perfanim.core.simulate.shipped_performance import DEMO, performance
from perfanim.core.simulate.studio.discs import draw_disc
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import SimulatedSource, simulated_source
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.studio_settings import StudioSettings
from perfanim.core.system.assets import MOTION
from perfanim.core.system.progress import Progress
from perfanim.core.vision.detection.blob_detector import Detector
from perfanim.core.vision.pipeline import MarkerPipeline

from .report import write_figures

_NOISE = 2.0  # grey levels
_DARK, _BRIGHT = 16.0, 220.0
_BLUR_PX = 0.5
_RADII_PX = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
_DISCS = 64  # an image holds
_DISC_IMAGES = 12
_MARKER_M = 0.0125
_BASELINE_M, _DISTANCE_M = 2.0, 3.0
_EXPOSURE_S = 0.004
_FPS = 60.0
_RUNS, _RUN_FRAMES, _RUN_MARKERS = 60, 10, 8
_SAME_M = 0.05  # a point this near to a true marker shows it
_LABEL_SECONDS = 20.0


@dataclass(frozen=True)
class _Case:
    """A condition of the labelling test."""

    title: str
    studio: StudioSettings


_CASES = (
    _Case("clean", StudioSettings(exposure_s=_EXPOSURE_S, occlusion=False)),
    _Case("hidden by the body", StudioSettings(exposure_s=_EXPOSURE_S)),
    _Case("20 % missing, three ghosts", StudioSettings(exposure_s=_EXPOSURE_S, occlusion=False, dropout=0.2, ghosts=3)),
)


def vision(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Measure centres, points and labels on simulated images, and write them.

    All motion is simulated: `data` and `workers` are unused.

    Returns:
        centroids (radius_px, rms_px of a coordinate), points (speed_m_s, rms_mm of the distance, found), labels (case,
        right, wrong, shares, and how many frames a marker that both see waits for its label), outputs.
    """
    progress(0.0, "centres of discs")
    centroids = [centroid_row(radius) for radius in _RADII_PX]
    progress(0.2, "points in space")
    points = _points((0.0, 1.0, 5.0))
    build_database([MOTION], out / "embedded.pfdb")
    database = open_database(out / "embedded.pfdb")
    labels = []
    for number, case in enumerate(_CASES):
        progress(0.4 + 0.6 * number / len(_CASES), f"labels: {case.title}")
        labels.append(_labels(case, database))
    figures: dict[str, Any] = {"centroids": centroids, "points": points, "labels": labels}
    return write_figures(out, "vision", figures, figures)


def centroid_row(radius_px: float) -> dict[str, float]:
    """Return coordinate error and share found of discs (radius in pixels) in noise."""
    rng = np.random.default_rng(7)
    detector = Detector()
    errors = []
    side = round(np.sqrt(_DISCS))
    for _ in range(_DISC_IMAGES):
        grid = 40.0 + 50.0 * np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
        centres = grid + rng.uniform(-5.0, 5.0, grid.shape)
        image = np.full((480, 640, 3), _DARK, dtype=np.uint8)
        for centre in centres:
            draw_disc(image, centre[None], radius_px, np.full(3, _BRIGHT), _BLUR_PX)
        found = detector.detect(_noisy(image, rng))[:, :2].astype(np.float64)
        apart = np.linalg.norm(found[:, None] - centres[None], axis=-1)
        near = apart.argmin(axis=1)
        hits = apart[np.arange(len(found)), near] < 1.0
        errors.append(found[hits] - centres[near[hits]])
    every = np.concatenate(errors)
    found_share = len(every) / (_DISC_IMAGES * side * side)
    return {"radius_px": radius_px, "rms_px": float(np.sqrt(np.mean(every**2))), "found": found_share}


def _noisy(image: Image, rng: np.random.Generator) -> Image:
    noise = rng.normal(0.0, _NOISE, image.shape)
    return np.asarray(np.clip(np.rint(image + noise), 0, 255), dtype=np.uint8)


def _points(speeds_m_s: tuple[float, ...]) -> list[dict[str, float]]:
    """Locate markers that cross the capture space at some speed.

    The cameras are calibrated from pictures of the board.
    """
    true = _rig()
    source = simulated_source(performance(DEMO), "boxing", Renderer(true, StudioSettings(noise_sigma=_NOISE)))
    rig = in_world_of(calibrate_studio(source).rig, true)
    return [_points_at(speed, true, rig) for speed in speeds_m_s]


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
    """Return the calibrated rig with its first camera where the true one is."""
    turn = true.cameras[0].rotation.T @ rig.cameras[0].rotation
    centre = rig.cameras[0].centre_m
    moved: list[Camera] = []
    for camera in rig.cameras:
        place = turn @ (camera.centre_m - centre) + true.cameras[0].centre_m
        rotation = camera.rotation @ turn.T
        moved.append(replace(camera, rotation=rotation, translation_m=-rotation @ place))
    return CameraRig(tuple(moved))


def _points_at(speed_m_s: float, true: CameraRig, rig: CameraRig) -> dict[str, float]:
    rng = np.random.default_rng(11)
    found: list[Array] = []
    targets: list[Array] = []
    wanted = 0
    for _ in range(_RUNS):
        pipeline = MarkerPipeline(rig)
        start = rng.uniform((-0.6, 0.5, -0.5), (0.6, 1.6, 0.5), (_RUN_MARKERS, 3))
        heading = rng.normal(size=3)
        velocity = speed_m_s * heading / np.linalg.norm(heading)
        for frame in range(_RUN_FRAMES):
            times = (frame - 0.5 * _RUN_FRAMES) / _FPS + _EXPOSURE_S * (np.arange(9) / 8 - 0.5)
            path = start[:, None] + velocity * times[:, None]
            images = tuple(_film(camera, path, rng) for camera in true.cameras)
            points = pipeline.process(_Moment(frame, (frame / _FPS,) * len(images), images)).points_m
            middle = path[:, 4]
            wanted += len(middle)
            if len(points):
                apart = np.linalg.norm(points[:, None] - middle[None], axis=-1)
                near = apart.argmin(axis=1)
                hits = apart[np.arange(len(points)), near] < _SAME_M
                found.append(points[hits])
                targets.append(middle[near[hits]])
    measured, truth = np.concatenate(found), np.concatenate(targets)
    errors = np.linalg.norm(measured - truth, axis=1)
    turn, shift = kabsch(measured, truth)
    left = np.linalg.norm(measured @ turn.T + shift - truth, axis=1)
    return {
        "speed_m_s": speed_m_s,
        "rms_mm": 1e3 * float(np.sqrt(np.mean(errors**2))),
        "rms_mm_after_rigid_fit": 1e3 * float(np.sqrt(np.mean(left**2))),
        "p99_mm": 1e3 * float(np.percentile(errors, 99)),
        "found": len(errors) / wanted,
    }


@dataclass(frozen=True)
class _Moment:
    """An image set."""

    number: int
    times_s: tuple[float, ...]
    images: tuple[Image, ...]


def _film(camera: Camera, path: Array, rng: np.random.Generator) -> Image:
    """Return an image of markers (M, 3) moving along paths (M, S, 3) while exposed."""
    width, height = camera.image_size
    image = np.full((height, width, 3), _DARK, dtype=np.uint8)
    depth = camera.to_camera(path.mean(axis=1))[:, 2]
    for marker in np.argsort(-depth):
        radius = camera.focal_px * _MARKER_M / float(depth[marker])
        draw_disc(image, camera.project(path[marker]), radius, np.full(3, _BRIGHT), _BLUR_PX)
    return _noisy(image, rng)


def _labels(case: _Case, database: Database) -> dict[str, Any]:
    """Track and solve with the true cameras and subject; count the labels given."""
    motion = performance(DEMO, _LABEL_SECONDS, mirrored=True)
    source = simulated_source(motion, "boxing", Renderer(default_rig(), case.studio))
    right = wrong = missed = 0
    waits: list[int] = []
    waiting = np.zeros(len(source.subject.marker_set), dtype=int)
    for named, seen in _named(source, database):
        wrong += int(np.sum(named >= 0) - np.sum(named == np.arange(len(named))))
        right += int(np.sum(named == np.arange(len(named))))
        late = seen & (named < 0)
        missed += int(np.sum(late))
        waits += [int(frames) for frames in waiting[seen & (named >= 0) & (waiting > 0)]]
        waiting = np.where(late, waiting + 1, 0)
    return {
        "case": case.title,
        "right": right,
        "wrong": wrong,
        "right_share": right / (right + wrong),
        "missed_share": missed / (right + wrong + missed),
        "longest_wait_frames": max(waits, default=0),
        "p99_wait_frames": float(np.percentile(waits, 99)) if waits else 0.0,
    }


def _named(source: SimulatedSource, database: Database) -> Any:
    """Yield, per frame, the true markers nearest to the labels, and those both see.

    The first is (M,), -1 for none.
    """
    pipeline = MarkerPipeline(source.rig)
    pipeline.learn_empty(source.background_frames(60))
    session = Session(source.subject, database, source.rig)
    for images in source:
        observed = session.step(pipeline.process(images)).observed_m
        apart = np.linalg.norm(observed[:, None] - images.truth.markers_m[None], axis=-1)
        located = np.isfinite(observed[:, 0])
        nearest = np.where(np.isfinite(apart), apart, np.inf).argmin(axis=1)
        yield np.where(located, nearest, -1), images.truth.visible.all(axis=0)

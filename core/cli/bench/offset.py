"""How well the time between two cameras is found, and what is gained: simulated cameras of which one is late."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...geometry.camera import CameraRig
from ...markers.marker_frame import MarkerFrame
from ...simulate.calibrated_studio import calibrate_studio
from ...simulate.performer import demo_performance, perform
from ...simulate.studio.filmed_motion import Performance
from ...simulate.studio.render import Renderer
from ...simulate.studio.rig import FPS, default_rig
from ...simulate.studio.settings import StudioSettings
from ...simulate.studio.source import simulated_source
from ...vision.pipeline import MarkerPipeline
from ...vision.sources.image_set import ImageSet
from ...vision.synchronise import synchronise_frames
from .data import Progress
from .report import write_json, write_rows
from .vision import in_world_of

Array = NDArray[np.float64]

_SECONDS = 10.0
_MOTIONS = ("walking", "boxing", "jumping", "kendo")
_OFFSETS_S = (0.0, 0.0042, 1.0 / 120.0, -0.013, 0.05)
_STUDIO: dict[str, Any] = {"exposure_s": 0.004, "noise_sigma": 2.0}
_ROLLING_S = 0.012
_EMPTY_FRAMES = 30


def offset(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Film performances of ten seconds with a camera that is late, find by how much, and write the errors.

    Args:
        data, workers: not needed; all motion is simulated.
        out: folder to write to.

    Returns:
        rows (motion, shutter, true and found offset, error and its claimed standard deviation in ms; distance of
        located points from the true markers in mm, median and 90th percentile, before and after), worst_ms, outputs.
    """
    true = default_rig()
    source = simulated_source(demo_performance(0), "boxing", Renderer(true, StudioSettings(**_STUDIO)))
    rig = in_world_of(calibrate_studio(source).rig, true)
    cases = [(motion, late_s, 0.0) for motion in _MOTIONS for late_s in _OFFSETS_S]
    cases += [(motion, 1.0 / 120.0, _ROLLING_S) for motion in _MOTIONS]
    rows = []
    for number, (motion, late_s, rolling_s) in enumerate(cases):
        progress(number / len(cases), f"{motion}, {1e3 * late_s:.1f} ms late")
        rows.append(offset_row(rig, motion, late_s, rolling_s))
    worst = max(abs(row["error_ms"]) for row in rows)
    write_json(out / "offset.json", {"rows": rows, "worst_ms": worst})
    write_rows(out / "offset.csv", rows)
    outputs = [str(out / name) for name in ("offset.json", "offset.csv")]
    return {"rows": rows, "worst_ms": worst, "outputs": outputs}


def offset_row(
    rig: CameraRig, motion: str, late_s: float, rolling_s: float, seconds: float = _SECONDS
) -> dict[str, Any]:
    """Return what is found of one performance, filmed by the default cameras, the second late by `late_s`.

    Args:
        rig: the default cameras as calibrated.
        motion: behaviour of the performer.
        late_s: seconds.
        rolling_s: time from the first row of an image to the last, seconds.
        seconds: how much of the performance is filmed.
    """
    settings = StudioSettings(time_offsets_s=(0.0, late_s), rolling_shutter_s=rolling_s, **_STUDIO)
    source = simulated_source(perform(motion, _SECONDS), "boxing", Renderer(default_rig(), settings))
    pipeline = MarkerPipeline(rig)
    pipeline.learn_empty(source.background_frames(_EMPTY_FRAMES))
    frames = []
    for number in range(round(seconds * FPS)):
        # as in a video: stamped by its number, whenever it was taken
        images = ImageSet(number, (number / FPS, number / FPS), source.frame(number).images)
        frames.append(pipeline.process(images))
    moved, offsets = synchronise_frames(rig, frames)
    found = offsets[1]
    return {
        "motion": motion,
        "rolling_shutter_ms": 1e3 * rolling_s,
        "true_ms": 1e3 * late_s,
        "found_ms": 1e3 * found.offset_s,
        "error_ms": 1e3 * (found.offset_s - late_s),
        "sigma_ms": 1e3 * found.sigma_s,
        **_errors_mm("before", frames, source.performance),
        **_errors_mm("after", moved, source.performance),
    }


def _errors_mm(when: str, frames: list[MarkerFrame], performance: Performance) -> dict[str, float]:
    """Return how far located points are from the nearest marker where it was at the frame's time."""
    errors = []
    for frame in frames:
        markers = performance.markers_at([frame.time_s])[0]
        if len(frame.points_m):
            errors.append(1e3 * np.linalg.norm(frame.points_m[:, None] - markers[None], axis=-1).min(axis=1))
    every = np.concatenate(errors)
    return {f"{when}_median_mm": float(np.median(every)), f"{when}_p90_mm": float(np.percentile(every, 90.0))}

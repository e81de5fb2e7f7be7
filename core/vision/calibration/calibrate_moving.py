"""Camera calibration without a board: by a person who walks about, or by markers that are waved through the room."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import CalibrationError, TakeError, counted
from ...geometry.arrays import Array, Mask
from ...geometry.camera import WORLD_FROM_CAMERA, Camera, CameraRig
from ...markers.floor_from_feet import floor_points
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_set import MarkerSet
from ..people.people_pipeline import PersonLocator
from ..tracked_take import labelled_take
from .board_quality import coverage
from .calibrate import CalibrationResult, calibration_summary
from .calibration_board import BoardView
from .moving_accuracy import LIMITS, MovingAccuracy, accuracy_of, moving_advice, rms_px, verdict_of
from .moving_fit import fit_moving
from .moving_targets import MovingTarget, PointTracks, WalkingPerson, WavedStick, marker_tracks, person_tracks
from .point_bundle import PointBundle
from .rig_fit import Rejected
from .rig_on_floor import rig_on_floor


@dataclass(frozen=True)
class MovingSettings:
    """Smallest recordings that are calibrated with."""

    fewest_moments: int = 30  # moments at which two cameras see the target
    shortest_s: float = 1.0  # time from the first of them to the last
    # way of a person across the image, in standard deviations of a point, which are about 25 mm
    least_way: float = 8.0


_S = MovingSettings()
_AGAIN = "walk about for 20 s where at least two cameras see the whole body"


@dataclass(frozen=True)
class MovingCalibration:
    """A calibration without a board."""

    result: CalibrationResult
    accuracy: MovingAccuracy
    has_floor: bool  # whether y = 0 is the floor, and the origin under the person

    def summary(self) -> dict[str, Any]:
        """Return the summary of a calibration by a board, and how well angles and focal lengths are known."""
        cameras = self.result.rig.cameras
        names = [camera.name for camera in cameras]
        return calibration_summary(self.result) | {
            "angle_sigma_deg": self.accuracy.angle_sigma_deg,
            "focal_px": {camera.name: camera.focal_px for camera in cameras},
            "focal_sigma_percent": dict(zip(names, (100.0 * self.accuracy.focal_sigmas).tolist(), strict=True)),
            "views_deg": self.accuracy.views_deg.tolist(),
            "floor": self.has_floor,
        }


def calibrate_with_person(
    cameras: Sequence[Camera],
    is_free: Mask,
    frames: Sequence[MarkerFrame],
    points: MarkerSet,
    height_m: float | None = None,
) -> MovingCalibration:
    """Calibrate cameras by a person who walks about.

    Args:
        cameras: Cameras with known lenses, or with usual ones where `is_free` (C,) says so; poses are not used.
        frames: What `PeoplePipeline.detect` returned.
        points: The network's points.
        height_m: Height of the person; None for that of an average adult.

    Raises:
        CalibrationError: The recording does not determine the cameras; the message names the cause.
    """
    for index, camera in enumerate(cameras):
        if not any(len(frame.blobs[index]) for frame in frames):
            raise CalibrationError(f"nobody was found in the pictures of {camera.name}", advice=_AGAIN)
    tracks = person_tracks(frames, points)
    _check_together(cameras, tracks, "the person", _AGAIN)
    _check_walk(tracks)
    target = WalkingPerson(tracks, points, height_m)
    bundle, accuracy = _fit(cameras, is_free, target)
    rig, advice = _with_floor(_rig(bundle), frames, points)
    if height_m is None:
        advice.append("all distances are those of an average adult: give the person's height")
    return _calibration(rig, bundle, accuracy, tracks, advice, "person")


def calibrate_with_markers(
    cameras: Sequence[Camera], is_free: Mask, frames: Sequence[MarkerFrame], stick_m: float = 0.0, apart_m: float = 0.0
) -> MovingCalibration:
    """Calibrate cameras by one marker, or by two on a stick, waved through the room.

    Args:
        cameras, is_free: As for `calibrate_with_person`.
        frames: What `MarkerPipeline.detect` returned.
        stick_m: Distance between the two markers of a stick; 0 for one marker.
        apart_m: For one marker, the distance between the first two cameras.

    Raises:
        CalibrationError: The recording does not determine the cameras; the message names the cause.
    """
    count = 2 if stick_m else 1
    tracks = marker_tracks(frames, count)
    what = "the two markers" if stick_m else "the marker"
    again = f"wave {what} through the whole room for 20 s, with nothing else that shines"
    _check_together(cameras, tracks, what, again)
    bundle, accuracy = _fit(cameras, is_free, WavedStick(tracks, stick_m, apart_m))
    advice = ["the floor is unknown: find it with the board or with markers that lie on it"]
    return _calibration(_rig(bundle), bundle, accuracy, tracks, advice, "markers")


def _check_together(cameras: Sequence[Camera], tracks: PointTracks, what: str, again: str) -> None:
    seen = np.isfinite(tracks.pixels[..., 0]).any(axis=2)
    for index, camera in enumerate(cameras):
        together = np.flatnonzero(seen[:, index] & (seen.sum(axis=1) >= 2))
        spent_s = float(np.ptp(tracks.times_s[together])) if len(together) else 0.0
        if len(together) < _S.fewest_moments or spent_s < _S.shortest_s:
            raise CalibrationError(
                f"{camera.name} and another camera saw {what} together at only {counted(len(together), 'moment')}, "
                f"within {spent_s:.1f} s",
                advice=again,
            )


def _check_walk(tracks: PointTracks) -> None:
    """Raise CalibrationError for a person who stays in one place."""
    ways = []
    for camera in range(tracks.pixels.shape[1]):
        known = np.isfinite(tracks.pixels[:, camera, :, 0])
        seen = known.any(axis=1)
        middle = np.nanmedian(tracks.pixels[seen, camera], axis=1)
        sigmas_px = np.where(known, tracks.sigmas_px[:, camera], np.inf)[seen].min(axis=1)
        sigma_px = float(np.median(sigmas_px))
        ways.append(float(np.hypot(*np.ptp(np.percentile(middle, (5.0, 95.0), axis=0), axis=0))) / sigma_px)
    if max(ways) < _S.least_way:
        raise CalibrationError("the person stays in one place", advice=_AGAIN)


def _fit(cameras: Sequence[Camera], is_free: Mask, target: MovingTarget) -> tuple[PointBundle, MovingAccuracy]:
    bundle = fit_moving(cameras, is_free, target)
    accuracy = accuracy_of(bundle, target.scale_sigma)
    if accuracy.views_deg.max() < LIMITS.least_view_deg:
        raise CalibrationError(
            f"the cameras stand side by side: they look from directions {accuracy.views_deg.max():.0f} degrees apart",
            advice="put them 60 to 110 degrees apart, as seen from the middle of the room",
        )
    return bundle, accuracy


def _rig(bundle: PointBundle) -> CameraRig:
    turned = (replace(camera, rotation=camera.rotation @ WORLD_FROM_CAMERA.T) for camera in bundle.cameras)
    return CameraRig(tuple(turned))


def _with_floor(rig: CameraRig, frames: Sequence[MarkerFrame], points: MarkerSet) -> tuple[CameraRig, list[str]]:
    """Return the rig on the floor under the person's feet, and advice if they do not show it."""
    located = PersonLocator(rig, points).locate_all(frames)
    fps = 1.0 / float(np.median(np.diff([frame.time_s for frame in frames])))
    take = labelled_take(located, points.names, "walk", fps, rig)
    try:
        return rig_on_floor(rig, floor_points(take, points)), []
    except (TakeError, CalibrationError) as error:
        return rig, [f"the floor was not found ({error.what}): walk where both cameras see the feet"]


def _calibration(
    rig: CameraRig,
    bundle: PointBundle,
    accuracy: MovingAccuracy,
    tracks: PointTracks,
    advice: Sequence[str],
    by: str,
) -> MovingCalibration:
    names = [camera.name for camera in rig.cameras]
    covered = [coverage(_views(tracks.pixels[:, c]), camera.image_size) for c, camera in enumerate(rig.cameras)]
    advice = (*moving_advice(bundle, accuracy, [each.fraction for each in covered]), *advice)
    verdict = verdict_of(accuracy)
    verdict = "usable" if advice and verdict == "good" else verdict
    errors_px = rms_px(bundle)
    total_px = float(np.sqrt(np.mean(errors_px**2)))
    seen = bundle.sightings.seen.any(axis=(1, 2))
    times_s = bundle.sightings.times_s[seen]
    alone = np.isfinite(tracks.pixels[..., 0]).any(axis=2).sum(axis=1) < 2
    rejected = (Rejected(counted(int(alone.sum()), "moment"), "fewer than two cameras saw it"),) if alone.any() else ()
    has_floor = "floor" in rig.metadata
    metadata = dict(rig.metadata) | {"error": total_px, "pictures": len(times_s), "verdict": verdict, "by": by}
    result = CalibrationResult(
        rig=replace(rig, metadata=metadata),
        stereo_rms_px=total_px,
        held_out_px=float("nan"),
        rms_px=dict(zip(names, errors_px.tolist(), strict=True)),
        baseline_m=rig.baseline_m(),
        distance_sigma=accuracy.distance_sigma,
        views_px={},
        coverage={name: each.fraction for name, each in zip(names, covered, strict=True)},
        late_s=dict(zip(names, bundle.delays_s.tolist(), strict=True)),
        used=tuple(f"{time_s:.2f} s" for time_s in times_s),
        rejected=rejected,
        verdict=verdict,
        advice=advice,
    )
    return MovingCalibration(result, accuracy, has_floor)


def _views(pixels: Array) -> list[BoardView]:
    """Return the points (F, K, 2) as views: a body's moments one by one, of one or two markers all together."""
    known = [rows[np.isfinite(rows[:, 0])] for rows in (pixels if pixels.shape[1] > 2 else [pixels.reshape(-1, 2)])]
    return [BoardView(np.arange(len(rows)), rows) for rows in known if len(rows)]

"""Request to track the markers in images of calibrated cameras."""

import argparse
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..database.store import Database, identity
from ..errors import SettingsError, TakeError
from ..formats.markers.marker_files import is_recorded, read_take, write_take
from ..formats.markers.recorded_take import take_of_poses
from ..formats.take_file.take_reader import read_take_file
from ..formats.take_file.take_setup import TakeSetup
from ..formats.take_file.take_writer import record_frames
from ..formats.take_file.whole_take import write_whole_take
from ..geometry.camera import CameraRig
from ..geometry.rig_file import save_rig
from ..labelling.trajectory_linking import track_markers
from ..labelling.trajectory_naming import match_trajectories, name_trajectories
from ..markers.floor_from_feet import floor_points, to_rig_world
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..session.multi_target_session import MultiTargetSession
from ..session.session import Session
from ..session.solve_take import solve_frames
from ..system.files import atomic_path
from ..system.progress import Progress
from ..vision.calibration.rig_on_floor import rig_on_floor
from ..vision.detection.blob_detector import DetectionSettings
from ..vision.pipeline import MarkerPipeline
from ..vision.sources.source_kinds import open_image_source
from ..vision.tracked_take import image_take, labelled_rms_px, synchronise_frames

Facts = dict[str, Any]

_BACKGROUND_SAMPLES = 31
_EMPTY_SAMPLES = 240  # of frames without the performer
_FAIR_SHARE = 0.25  # of the frames: single markers are hidden more often than all are shown
_DETECTION_SHARE = 0.6  # of the work, for the progress shown
_WRONG_MM = 100.0  # solved markers so far off mean that the labels are wrong
_LATER = "none: perfanim solve gives them by the body"
_NO_SET = "a .perftake without a body holds no marker set: give it to perfanim solve with --skeleton"
_GUESSED = "labels are guessed without a body; give --subject and --database"


@dataclass(frozen=True)
class TrackImages:
    """Images to a marker take, or to a recorded take without labels.

    Args:
        rig: one camera for each source.
        sources: videos, folders or patterns of images, devices.
        marker_set: names the trajectories; None for M01, M02, ...
        subject: the performer, if known, with this marker set.
        database: labels the trajectories with the subject; a recorded take only names it.
    """

    options: argparse.Namespace
    rig: CameraRig
    sources: Sequence[str]
    marker_set: MarkerSet | None = None
    subject: Subject | None = None
    database: Database | None = None

    def run(self, progress: Progress) -> Facts:
        """Track, write the take, return the summary.

        Raises:
            PerfanimError: a source cannot be opened or has no end, or the output cannot be written.
        """
        spent_s: list[float] = []
        with closing(
            open_image_source(*self.sources, fps=self.options.fps, size=self.rig.cameras[0].image_size)
        ) as source:
            pipeline = self._pipeline(source, progress)
            frames = self._detect(pipeline, source, spent_s, progress)
            if is_recorded(self.options.out):
                facts = self._record(frames, keep_cut=_is_endless(source))
            else:
                facts = self._write_trajectories(tuple(frames), source.fps, progress)
        return facts | {
            "frames_per_s": len(spent_s) / max(sum(spent_s), 1e-9),
            "warnings": [*getattr(source, "warnings", ()), *facts["warnings"]],
            "out": self.options.out,
        }

    def _pipeline(self, source: Any, progress: Progress) -> MarkerPipeline:
        pipeline = make_pipeline(self.options, self.rig, progress)
        if self.options.background:
            return pipeline
        samples = [] if _is_endless(source) else list(source.samples(_BACKGROUND_SAMPLES))
        if len(samples) > 1:
            pipeline.learn_from_take(samples)
        return pipeline

    def _detect(
        self, pipeline: MarkerPipeline, source: Any, spent_s: list[float], progress: Progress
    ) -> Iterator[MarkerFrame]:
        """Yield the marker frames; add the time that each took."""
        if self.options.seconds is None and _is_endless(source):
            raise SettingsError("a camera has no end", advice="say how long to record, e.g. --seconds 10")
        total = int(getattr(source, "frames", 0)) or round((self.options.seconds or 0.0) * source.fps)
        for done, images in enumerate(source):
            if self.options.seconds is not None and max(images.times_s) >= self.options.seconds:
                return
            if done % 10 == 0:
                progress(min(_DETECTION_SHARE, _DETECTION_SHARE * done / max(total, 1)), f"frame {done} of {total}")
            start = time.perf_counter()
            frame = pipeline.process(images)
            spent_s.append(time.perf_counter() - start)
            yield frame

    def _record(self, frames: Iterator[MarkerFrame], *, keep_cut: bool) -> Facts:
        """Write a recorded take while its frames come, and return its figures."""
        performers = (self.subject,) if self.subject is not None else ()
        known = identity(self.database) if self.database is not None else {}
        capture = {"tracked": list(self.sources), "threshold": self.options.threshold}
        setup = TakeSetup.of(self.rig, performers, {}, known, capture)
        written = record_frames(Path(self.options.out), setup, frames, keep_cut=keep_cut)
        try:
            take = read_take_file(written)
            moved, facts = self._synchronise(take.frames)
            if facts.get("time_offsets_applied"):
                stamps_s = [stamp_s for stamp_s, _ in take.stamped_frames]
                write_whole_take(written, setup, take.notes, list(zip(stamps_s, moved, strict=True)), [])
            with atomic_path(self.options.out) as temporary:
                written.replace(temporary)
        finally:
            written.unlink(missing_ok=True)
        facts["warnings"] += [_NO_SET] * (self.marker_set is not None and self.subject is None)
        return facts | {"names": [], "labels": _LATER}

    def _synchronise(self, frames: Sequence[MarkerFrame]) -> tuple[Sequence[MarkerFrame], Facts]:
        """Return the frames at one time of all cameras, and their figures."""
        aligned: Facts = {}
        if len(self.rig) > 1 and not self.options.no_time_offset:
            frames, offsets = synchronise_frames(self.rig, frames)
            aligned = {
                "time_offsets_ms": [1e3 * offset.offset_s if offset.is_found else None for offset in offsets],
                "time_offset_sigmas_ms": [1e3 * offset.sigma_s if offset.is_found else None for offset in offsets],
                "time_offsets_applied": any(offset.is_certain for offset in offsets),
            }
        return frames, frame_facts(self.rig, frames, self._worn) | aligned

    def _write_trajectories(self, seen: Sequence[MarkerFrame], fps: float, progress: Progress) -> Facts:
        frames, facts = self._synchronise(seen)
        found: Facts = {"labels": _LATER, "warnings": []}
        progress(_DETECTION_SHARE, "labelling")
        if len(self.rig) == 1 and self.database is None:
            take = image_take(frames, self.rig, self._name, fps)
        else:
            take, found = self._guess(frames, fps) if self.database is None else self._label(frames, fps, progress)
            found |= {
                "markers": len(take.names),
                "visible_fraction": float(take.visible.mean()),
                "all_visible_fraction": float(take.visible.all(axis=1).mean()),
            }
        if self.options.truth:
            found |= compare_takes(take, read_take(self.options.truth))
        if self.options.floor == "feet" and self.marker_set is not None:
            take = self._moved_to_floor(take, self.marker_set)
        write_take(take, self.options.out)
        return facts | found | {"names": list(take.names), "warnings": facts["warnings"] + found["warnings"]}

    def _label(self, frames: Sequence[MarkerFrame], fps: float, progress: Progress) -> tuple[MarkerTake, Facts]:
        """Return the take with the labels of a session, and figures of the fit."""
        assert self.subject is not None and self.database is not None  # noqa: S101 - checked with the options
        session = Session(self.subject, self.database, self.rig)

        def after_detection(fraction: float, text: str) -> None:
            progress(_DETECTION_SHARE + (1.0 - _DETECTION_SHARE) * fraction, text)

        solved = solve_frames(frames, MultiTargetSession([session]), "labelling", after_detection)
        name = self.subject.name
        take = take_of_poses(solved.poses_of(), self.subject.marker_set.names, self._name, fps, self.rig)
        measured, advice = solved.summary(), "check --subject and --marker-set"
        if not any(np.isfinite(pose.marker_rms_m) for pose in solved.poses_of()):
            raise TakeError(f"no frame shows the body of {name}", advice=advice)
        off_mm = measured["marker_rms_mm"]
        wrong = f"the body of {name} does not explain the markers ({off_mm:.0f} mm off): {advice}"
        return take, {
            "labels": f"by the body of {name}",
            "one_camera_fraction": float(np.mean([pose.single_cameras >= 0 for pose in solved.poses_of()])),
            "marker_rms_mm": off_mm,
            "confidence": measured["confidence"],
            "warnings": [wrong] * (off_mm > _WRONG_MM),
        }

    def _guess(self, frames: Sequence[MarkerFrame], fps: float) -> tuple[MarkerTake, Facts]:
        """Return the take of two or more cameras with labels by votes, and its figures."""
        tracking = track_markers(frames, self._name, fps, self._worn)
        take = name_trajectories(tracking.take, self.marker_set) if self.marker_set else tracking.take
        return take, {
            "labels": "guessed without a body",
            "reprojection_rms_px": labelled_rms_px(self.rig, frames, tracking.labels),
            "false_pieces": tracking.dropped_tracklets,
            "warnings": [_GUESSED],
        }

    def _moved_to_floor(self, take: MarkerTake, marker_set: MarkerSet) -> MarkerTake:
        """Return the take with its floor at y = 0; write that calibration if requested."""
        level = rig_on_floor(self.rig, floor_points(take, marker_set))
        if self.options.floor_cameras:
            save_rig(level, self.options.floor_cameras)
        return to_rig_world(take, self.rig, level)

    @property
    def _worn(self) -> int | None:
        """How many markers are worn; None where that is not known."""
        return len(self.marker_set) if self.marker_set else self.options.markers

    @property
    def _name(self) -> str:
        return Path(self.options.out).name.removesuffix(".npz").removesuffix(".take").split(".")[0] or "take"


def make_pipeline(options: argparse.Namespace, rig: CameraRig, progress: Progress) -> MarkerPipeline:
    """Return the pipeline of --threshold, its background learned from --background."""
    pipeline = MarkerPipeline(rig, DetectionSettings(threshold=options.threshold))
    progress(0.0, "learning the background")
    if options.background:
        with closing(open_image_source(*options.background)) as empty:
            pipeline.learn_empty(empty.samples(_EMPTY_SAMPLES))
    return pipeline


def _is_endless(source: Any) -> bool:
    return int(getattr(source, "frames", 0)) <= 0


def frame_facts(rig: CameraRig, frames: Sequence[MarkerFrame], worn: int | None) -> Facts:
    """Return the figures of markers without labels.

    `worn` is how many there are; None: as many as are seen in a quarter of the frames.

    Raises:
        TakeError: no frame shows any.
    """
    points = np.array([len(frame.points_m) for frame in frames])
    rays = np.array([len(frame.single_points) for frame in frames])
    shown = np.sort(rays if len(rig) == 1 else points)[::-1]
    if not shown.any():
        advice = "check the threshold, the cameras' order and the calibration"
        raise TakeError("hardly any markers were found", advice=advice)
    worn = worn or max(int(shown[int(_FAIR_SHARE * len(shown))]), 1)
    located = np.minimum(points, worn)
    return {
        "frames": len(frames),
        "lost_frames": frames[-1].number - frames[0].number + 1 - len(frames),
        "markers": worn,
        "visible_fraction": float(np.mean(located / worn)),
        "all_visible_fraction": float(np.mean(points >= worn)),
        "one_camera_fraction": float(np.mean(np.minimum(rays, worn - located) / worn)),
        "reprojection_rms_px": labelled_rms_px(rig, frames, [np.arange(n) for n in points]) if points.any() else None,
        "warnings": list(dict.fromkeys(note for frame in frames for note in frame.notes)),
    }


def compare_takes(take: MarkerTake, truth: MarkerTake) -> Facts:
    """Return the distances to true trajectories, paired to fit best over the take."""
    frames = min(take.frames, truth.frames)
    own, other = take.positions_m[:frames], truth.positions_m[:frames]
    # trajectories in the left camera's own frame (x right, y down, z forward) are turned into the world
    turned = other * np.array([1.0, -1.0, -1.0])
    if np.nanmedian(np.abs(own[..., 2] - turned[..., 2])) < np.nanmedian(np.abs(own[..., 2] - other[..., 2])):
        other = turned
    rows, columns = match_trajectories(own, other)
    distance = np.linalg.norm(own[:, rows] - other[:, columns], axis=2)
    return {
        "truth_frames": frames,
        "truth_pairs": {take.names[r]: truth.names[c] for r, c in zip(rows, columns, strict=True)},
        "distance_median_mm": 1000.0 * float(np.nanmedian(distance)),
        "distance_p95_mm": 1000.0 * float(np.nanpercentile(distance, 95)),
    }

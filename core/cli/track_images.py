"""Request to track the markers in images of calibrated cameras."""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SettingsError
from ..formats.markers.marker_files import read_take, write_take
from ..geometry.camera import CameraRig
from ..geometry.rig_file import save_rig
from ..labelling.single_camera_trajectories import single_views
from ..labelling.trajectory_linking import track_markers
from ..labelling.trajectory_naming import match_trajectories, name_trajectories
from ..markers.floor_from_feet import floor_points, to_rig_world
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from ..system.progress import Progress
from ..vision.calibration.floor import rig_on_floor
from ..vision.detection.blob_detector import DetectionSettings
from ..vision.image_take import image_take
from ..vision.pipeline import MarkerPipeline, PipelineSettings
from ..vision.reprojection import labelled_rms_px
from ..vision.sources.source_kinds import open_image_source
from ..vision.synchronise import synchronise_frames

Facts = dict[str, Any]

_BACKGROUND_SAMPLES = 31
_EMPTY_SAMPLES = 240  # of frames without the performer


@dataclass(frozen=True)
class TrackImages:
    """Images to a marker take.

    Args:
        options: of `perfanim track`.
        rig: one camera for each source.
        sources: videos, folders or patterns of images, devices.
        marker_set: names the trajectories; None for M01, M02, ...
    """

    options: argparse.Namespace
    rig: CameraRig
    sources: Sequence[str]
    marker_set: MarkerSet | None = None

    def run(self, progress: Progress) -> Facts:
        """Track, write the take, return the summary.

        Raises:
            PerfanimError: a source cannot be opened or has no end, or the output cannot be written.
        """
        source: Any = open_image_source(*self.sources, fps=self.options.fps, size=self.rig.cameras[0].image_size)
        try:
            pipeline = self._pipeline(source, progress)
            frames, seconds = self._detect(pipeline, source, progress)
        finally:
            source.close()
        count = len(self.marker_set) if self.marker_set else self.options.markers
        if len(self.rig) == 1:
            take, found = self._one_camera_take(frames, source.fps, count)
        else:
            take, found = self._take(frames, source.fps, count, pipeline.settings, progress)
        facts = found | {
            "frames": take.frames,
            "lost_frames": int(take.frame_numbers[-1] - take.frame_numbers[0]) + 1 - take.frames,
            "names": list(take.names),
            "frames_per_s": len(frames) / max(seconds, 1e-9),
            "warnings": [*getattr(source, "warnings", ()), *dict.fromkeys(note for f in frames for note in f.notes)],
            "out": self.options.out,
        }
        if self.options.truth:
            facts |= compare_takes(take, read_take(self.options.truth))
        write_take(self._moved_to_floor(take) if self.options.floor == "feet" else take, self.options.out)
        return facts

    def _pipeline(self, source: Any, progress: Progress) -> MarkerPipeline:
        pipeline = make_pipeline(self.options, self.rig, progress)
        if self.options.background:
            return pipeline
        samples = [] if _is_endless(source) else list(source.samples(_BACKGROUND_SAMPLES))
        if len(samples) > 1:
            pipeline.learn_from_take(samples)
        return pipeline

    def _detect(self, pipeline: MarkerPipeline, source: Any, progress: Progress) -> tuple[list[MarkerFrame], float]:
        """Return the marker frames, and the seconds that the pipeline took."""
        if self.options.seconds is None and _is_endless(source):
            raise SettingsError("a camera has no end", advice="say how long to record, e.g. --seconds 10")
        total = int(getattr(source, "frames", 0)) or round((self.options.seconds or 0.0) * source.fps)
        frames: list[MarkerFrame] = []
        seconds = 0.0
        for images in source:
            if self.options.seconds is not None and max(images.times_s) >= self.options.seconds:
                break
            start = time.perf_counter()
            frames.append(pipeline.process(images))
            seconds += time.perf_counter() - start
            if len(frames) % 10 == 0:
                progress(min(0.95, 0.95 * len(frames) / max(total, 1)), f"frame {len(frames)} of {total}")
        return frames, seconds

    def _take(
        self, frames: list[MarkerFrame], fps: float, count: int | None, settings: PipelineSettings, progress: Progress
    ) -> tuple[MarkerTake, Facts]:
        """Return the take of two or more cameras, and its figures."""
        aligned: Facts = {}
        if not self.options.no_time_offset:
            progress(0.95, "comparing the cameras' times")
            frames, offsets = synchronise_frames(self.rig, frames, settings)
            aligned = {
                "time_offsets_ms": [1e3 * offset.offset_s if offset.is_found else None for offset in offsets],
                "time_offset_sigmas_ms": [1e3 * offset.sigma_s if offset.is_found else None for offset in offsets],
                "time_offsets_applied": any(offset.is_certain for offset in offsets),
            }
        progress(0.97, "joining points to trajectories")
        tracking = track_markers(frames, self._name, fps, count)
        single = single_views(tracking, frames, self.rig)
        take = replace(tracking.take, single=single)
        take = name_trajectories(take, self.marker_set) if self.marker_set else take
        return take, aligned | {
            "markers": len(take.names),
            "visible_fraction": float(take.visible.mean()),
            "all_visible_fraction": float(take.visible.all(axis=1).mean()),
            "one_camera_fraction": float((single.cameras >= 0).mean()),
            "reprojection_rms_px": labelled_rms_px(self.rig, frames, tracking.labels),
            "false_pieces": tracking.dropped_tracklets,
        }

    def _one_camera_take(self, frames: list[MarkerFrame], fps: float, count: int | None) -> tuple[MarkerTake, Facts]:
        """Return the take of one camera, and its figures; its markers have no labels."""
        take = image_take(frames, self.rig, self._name, fps)
        shown = np.array([len(frame.single_points) for frame in frames])
        worn = count or int(shown.max())
        return take, {
            "markers": worn,
            "visible_fraction": 0.0,
            "one_camera_fraction": float(np.minimum(shown / max(worn, 1), 1.0).mean()),
            "reprojection_rms_px": None,
        }

    def _moved_to_floor(self, take: MarkerTake) -> MarkerTake:
        """Return the take with its floor at y = 0; write that calibration if requested."""
        if self.marker_set is None:
            raise SettingsError("--floor feet needs --marker-set", advice="name the marker set that is worn")
        level = rig_on_floor(self.rig, floor_points(take, self.marker_set))
        if self.options.floor_cameras:
            save_rig(level, self.options.floor_cameras)
        return to_rig_world(take, self.rig, level)

    @property
    def _name(self) -> str:
        return Path(self.options.out).name.removesuffix(".npz").removesuffix(".take").split(".")[0] or "take"


def make_pipeline(options: argparse.Namespace, rig: CameraRig, progress: Progress) -> MarkerPipeline:
    """Return the pipeline of --threshold, its background learned from --background."""
    pipeline = MarkerPipeline(rig, PipelineSettings(detection=(DetectionSettings(threshold=options.threshold),)))
    progress(0.0, "learning the background")
    if options.background:
        empty: Any = open_image_source(*options.background)
        try:
            pipeline.learn_empty(empty.samples(_EMPTY_SAMPLES))
        finally:
            empty.close()
    return pipeline


def _is_endless(source: Any) -> bool:
    return int(getattr(source, "frames", 0)) <= 0


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

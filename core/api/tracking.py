"""Tracking of markers in the images of calibrated cameras, into trajectories or a recorded take."""

import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

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
from ..labelling.human_size import has_human_shape
from ..labelling.trajectory_linking import track_markers
from ..labelling.trajectory_naming import compare_takes, name_trajectories
from ..markers.floor_from_feet import floor_points, to_rig_world
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_set import MarkerSet, load_marker_set
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..session.multi_target_session import MultiTargetSession
from ..session.session import Session
from ..session.solve_take import solve_frames
from ..session.verdict import VerdictSettings
from ..system.files import atomic_path
from ..system.progress import Progress, no_progress
from ..system.schema import About, check_ranges
from ..vision.calibration.rig_on_floor import rig_on_floor
from ..vision.detection.blob_detector import DetectionSettings
from ..vision.people.body_network import BlazePose
from ..vision.people.people_pipeline import PeoplePipeline
from ..vision.people.person_clocks import synchronise_person
from ..vision.pipeline import MarkerPipeline
from ..vision.sources.source_kinds import open_image_source
from ..vision.tracked_take import image_take, labelled_rms_px, labelled_take, relocate, synchronise_frames

Facts = dict[str, Any]

_LATER = "none: solving the take labels the markers"
_NETWORKS = "those of the body network"
GUESSED = "labels are guessed without a body; name the performer and a motion database"
"""Warning about trajectories; it does not apply to a take whose body is fitted next."""
_NO_PERSON = "what the network found does not have the shape of a person: it also finds people in animals and things"


@dataclass(frozen=True)
class _Settings:
    background_samples: int = 31  # images of the take used to learn its background
    empty_samples: int = 240  # largest number of images without the performer used to learn the background
    worn_share: float = 0.25  # share of frames in which all worn markers are assumed visible, to count them
    usual_share: float = 0.9  # share of frames that must show more markers than are worn before these are doubted
    unworn: int = 2  # number of further markers


_SETTINGS = _Settings()


@dataclass(frozen=True)
class TrackRequest:
    """Images to track, and the take to write."""

    rig: Annotated[CameraRig, About("calibrated cameras, one for each source")]
    sources: Annotated[tuple[str, ...], About("videos, folders or patterns of images, devices, stream addresses")]
    out: Annotated[
        str,
        About(
            "take to write: .take.npz, .trc, .csv or .c3d; or .perftake for everything that the cameras saw, which is "
            "labelled when it is solved",
        ),
    ]
    marker_set: Annotated[MarkerSet | None, About("marker set; without one, trajectories are M01, M02, ...")] = None
    subject: Annotated[Subject | None, About("performer, with this marker set")] = None
    database: Annotated[
        Database | None, About("motion database, to label the markers with the body; a recorded take only names it")
    ] = None
    background: Annotated[
        tuple[str, ...],
        About("images without the performer, one source per camera (default: learned from the take itself)"),
    ] = ()
    people: Annotated[str | None, About("file of a body network, with which a person without markers is tracked")] = (
        None
    )
    threshold: Annotated[
        float | None, About("grey levels above the background (default: automatic)", "grey levels")
    ] = None
    fps: Annotated[
        float | None, About("frames per second, if the source does not state them", "frames per second", 1.0, 1000.0)
    ] = None
    seconds: Annotated[
        float | None, About("stop after this many seconds (required for live cameras)", "s", above=0.0, most=86400.0)
    ] = None
    markers: Annotated[
        int | None,
        About("number of markers worn (default: the set's, or estimated from the visible ones)", "", 1, 200),
    ] = None
    time_offsets: Annotated[
        bool, About("shift the markers of a camera that is found to be late to the time of the others")
    ] = True
    floor: Annotated[
        str,
        About(
            "world of the take: the calibration's (camera), or with the floor under the feet at y = 0 (feet; needs a "
            "marker set with markers on the feet)",
            choices=("camera", "feet"),
        ),
    ] = "camera"
    level_rig: Annotated[str | None, About("file to write the calibration to, moved to that floor")] = None
    truth: Annotated[
        str | None, About("trajectories to compare with, frame by frame (.trc, .c3d, .csv, .take.npz)")
    ] = None

    def __post_init__(self) -> None:
        check_ranges(self)

    @property
    def worn(self) -> int | None:
        """Number of markers worn; None if unknown."""
        if self.people:
            return len(self.points)
        return len(self.marker_set) if self.marker_set else self.markers

    @property
    def points(self) -> MarkerSet:
        """Points of the body network."""
        return load_marker_set(BlazePose.marker_set)

    @property
    def name(self) -> str:
        """Name of the take."""
        return Path(self.out).name.removesuffix(".npz").removesuffix(".take").split(".")[0] or "take"


def track(request: TrackRequest, progress: Progress = no_progress) -> Facts:
    """Track the markers, write the take, and return figures and warnings.

    Raises:
        CaptureError: A source cannot be opened.
        SettingsError: A live camera is tracked without a time limit.
        TakeError: No markers were found, or they do not belong to the performer.
        FormatError: The output cannot be written.
    """
    spent_s: list[float] = []
    with closing(
        open_image_source(
            *request.sources,
            fps=request.fps,
            size=request.rig.cameras[0].image_size,
            together=not (request.people and request.time_offsets),
        )
    ) as source:
        pipeline = _people(request) if request.people else _pipeline(request, source, progress)
        frames = _detect(request, pipeline, source, spent_s, progress)
        if is_recorded(request.out):
            facts = _record(request, frames, keep_cut=_is_endless(source))
        else:
            facts = _write_trajectories(request, tuple(frames), source.fps, progress)
    return facts | {
        "frames_per_s": len(spent_s) / max(sum(spent_s), 1e-9),
        "warnings": [*getattr(source, "warnings", ()), *facts["warnings"]],
        "out": request.out,
    }


def _people(request: TrackRequest) -> PeoplePipeline:
    network = BlazePose(Path(request.people or ""))
    return PeoplePipeline(request.rig, [network] * len(request.rig))


def _pipeline(request: TrackRequest, source: Any, progress: Progress) -> MarkerPipeline:
    pipeline = make_pipeline(request.rig, request.threshold, request.background, progress)
    if not request.background and not _is_endless(source):
        learn_from_source(pipeline, source)
    return pipeline


def learn_from_source(pipeline: MarkerPipeline, source: Any) -> None:
    """Learn the background from the take's own images, unless the take has only one."""
    samples = list(source.samples(_SETTINGS.background_samples))
    if len(samples) > 1:
        pipeline.learn_from_take(samples)


def _detect(
    request: TrackRequest,
    pipeline: MarkerPipeline | PeoplePipeline,
    source: Any,
    spent_s: list[float],
    progress: Progress,
) -> Iterator[MarkerFrame]:
    """Yield the marker frames; append each frame's computing time, s, to `spent_s`."""
    if request.seconds is None and _is_endless(source):
        raise SettingsError("a recording from live cameras needs a duration", advice="say how many seconds to record")
    total = int(getattr(source, "frames", 0)) or round((request.seconds or 0.0) * source.fps)
    for done, images in enumerate(source):
        if request.seconds is not None and max(images.times_s) >= request.seconds:
            return
        if done % 10 == 0:
            progress(0.6 * min(1.0, done / max(total, 1)), f"frame {done} of {total}")
        start = time.perf_counter()
        frame = pipeline.process(images)
        spent_s.append(time.perf_counter() - start)
        yield frame


def _record(request: TrackRequest, frames: Iterator[MarkerFrame], *, keep_cut: bool) -> Facts:
    """Write frames to a recorded take as they arrive; return its figures."""
    performers = (request.subject,) if request.subject is not None else ()
    known = identity(request.database) if request.database is not None else {}
    capture = {"tracked": list(request.sources), "threshold": request.threshold, "people": request.people or ""}
    setup = TakeSetup.of(request.rig, performers, {}, known, capture)
    written = record_frames(Path(request.out), setup, frames, keep_cut=keep_cut)
    try:
        take = read_take_file(written)
        moved, facts = _synchronise(request, take.frames)
        if request.people or facts.get("time_offsets_applied"):
            stamps_s = [stamp_s for stamp_s, _ in take.stamped_frames]
            write_whole_take(written, setup, take.notes, list(zip(stamps_s[: len(moved)], moved, strict=True)), [])
        with atomic_path(request.out) as temporary:
            written.replace(temporary)
    finally:
        written.unlink(missing_ok=True)
    if request.marker_set is not None and request.subject is None:
        facts["warnings"].append(
            "a .perftake without a performer stores no marker set: name the set when you solve the take"
        )
    return facts | {"names": [], "labels": _NETWORKS if request.people else _LATER}


def _synchronise(request: TrackRequest, frames: Sequence[MarkerFrame]) -> tuple[Sequence[MarkerFrame], Facts]:
    """Return the frames with the blobs of all cameras moved to one time, and figures about them.

    Frames of a person are located again, too, with what the whole take tells about left and right.
    """
    aligned: Facts = {}
    if len(request.rig) > 1 and request.time_offsets:
        if request.people:
            frames, offsets = synchronise_person(request.rig.cameras, frames, request.points, placed=True)
            applied = any(offset.is_found for offset in offsets[1:])
        else:
            frames, offsets = synchronise_frames(request.rig, frames)
            applied = any(offset.is_certain for offset in offsets)
        aligned = {
            "time_offsets_ms": [1e3 * offset.offset_s if offset.is_found else None for offset in offsets],
            "time_offset_sigmas_ms": [1e3 * offset.sigma_s if offset.is_found else None for offset in offsets],
            "time_offsets_applied": applied,
        }
    if request.people:
        frames = relocate(request.rig, frames)
    return frames, _frame_facts(request, frames) | aligned


def _write_trajectories(request: TrackRequest, seen: Sequence[MarkerFrame], fps: float, progress: Progress) -> Facts:
    frames, facts = _synchronise(request, seen)
    found: Facts = {"labels": _LATER, "warnings": []}
    progress(0.6, "labelling")
    if request.people:
        take = labelled_take(frames, request.points.names, request.name, fps, request.rig)
        found |= {"labels": _NETWORKS, "warnings": [] if has_human_shape(take, request.points) else [_NO_PERSON]}
    elif len(request.rig) == 1 and request.database is None:
        take = image_take(frames, request.rig, request.name, fps)
    else:
        labelled = request.database is not None
        take, found = _label(request, frames, fps, progress) if labelled else _guess(request, frames, fps)
        found |= {
            "markers": len(take.names),
            "visible_fraction": float(take.visible.mean()),
            "all_visible_fraction": float(take.visible.all(axis=1).mean()),
        }
    if request.truth:
        found |= compare_takes(take, read_take(request.truth))
    worn = request.points if request.people else request.marker_set
    if request.floor == "feet" and worn is not None:
        take, found["camera_heights_mm"] = _to_floor(request, take, worn)
    write_take(take, request.out)
    return facts | found | {"names": list(take.names), "warnings": facts["warnings"] + found["warnings"]}


def _label(
    request: TrackRequest, frames: Sequence[MarkerFrame], fps: float, progress: Progress
) -> tuple[MarkerTake, Facts]:
    """Return the take as labelled by a session, and figures about the fit."""
    assert request.subject is not None and request.database is not None  # noqa: S101 - checked with the options
    session = Session(request.subject, request.database, request.rig)

    def after_detection(fraction: float, text: str) -> None:
        progress(0.6 + 0.4 * fraction, text)

    solved = solve_frames(frames, MultiTargetSession([session]), "labelling", after_detection)
    name = request.subject.name
    take = take_of_poses(solved.poses_of(), request.subject.marker_set.names, request.name, fps, request.rig)
    measured, advice = solved.summary(), "check the subject and the marker set"
    if not any(np.isfinite(pose.marker_rms_m) for pose in solved.poses_of()):
        raise TakeError(f"no frame shows the body of {name}", where=request.name, advice=advice)
    off_mm = measured["marker_rms_mm"]
    wrong = f"the body of {name} does not explain the markers ({off_mm:.0f} mm off): {advice}"
    return take, {
        "labels": f"found with the body of {name}",
        "one_camera_fraction": float(np.mean([pose.single_cameras >= 0 for pose in solved.poses_of()])),
        "marker_rms_mm": off_mm,
        "confidence": measured["confidence"],
        "warnings": [wrong] * (off_mm > 1e3 * VerdictSettings().wrong_m),
    }


def _guess(request: TrackRequest, frames: Sequence[MarkerFrame], fps: float) -> tuple[MarkerTake, Facts]:
    """Return the labelled take of two or more cameras and its figures; labels are decided over all frames."""
    tracking = track_markers(frames, request.name, fps, request.worn)
    take = name_trajectories(tracking.take, request.marker_set) if request.marker_set else tracking.take
    return take, {
        "labels": "guessed without a body",
        "reprojection_rms_px": labelled_rms_px(request.rig, frames, tracking.labels),
        "false_pieces": tracking.dropped_tracklets,
        "warnings": [GUESSED],
    }


def _to_floor(request: TrackRequest, take: MarkerTake, worn: MarkerSet) -> tuple[MarkerTake, dict[str, float]]:
    """Return the take with its floor at y = 0 and the heights of the cameras; write their calibration if requested."""
    level = rig_on_floor(request.rig, floor_points(take, worn))
    if request.level_rig:
        save_rig(level, request.level_rig)
    return to_rig_world(take, request.rig, level), level.heights_mm


def make_pipeline(
    rig: CameraRig, threshold: float | None, background: Sequence[str], progress: Progress
) -> MarkerPipeline:
    """Return a pipeline that has learned the background from sources without the performer, if any are given."""
    pipeline = MarkerPipeline(rig, DetectionSettings(threshold=threshold))
    progress(0.0, "learning the background")
    if background:
        with closing(open_image_source(*background)) as empty:
            pipeline.learn_empty(empty.samples(_SETTINGS.empty_samples))
    return pipeline


def _is_endless(source: Any) -> bool:
    return int(getattr(source, "frames", 0)) <= 0


def _frame_facts(request: TrackRequest, frames: Sequence[MarkerFrame]) -> Facts:
    """Return figures about markers; if the number worn is unknown, the one that a quarter of the frames reach is used.

    Raises:
        TakeError: No frame shows any markers, or the person.
    """
    rig, worn = request.rig, request.worn
    points = np.array([len(frame.points_m) for frame in frames])
    rays = np.array([len(frame.single_points) for frame in frames])
    shown = np.sort(rays if len(rig) == 1 else points)[::-1]
    if not shown.any():
        if request.people:
            advice = "check the light, and that the images show the whole body"
            empty = [
                camera.name
                for index, camera in enumerate(rig.cameras)
                if not any(len(f.detected[index]) for f in frames)
            ]
            where = f" in the images of {' and '.join(empty)}" if empty else " by two cameras at the same time"
            raise TakeError("nobody was found" + where, advice=advice)
        advice = "check the threshold, the cameras' order and the calibration"
        raise TakeError("no markers were found", advice=advice)
    # so many markers are there nearly always; a reflection is alone, or comes and goes
    usual = int(shown[int(_SETTINGS.usual_share * (len(shown) - 1))])
    doubts: Facts = {}
    if worn and not request.people and usual >= worn + _SETTINGS.unworn:
        text = f"nearly every frame shows {usual} markers, but {worn} are worn; choose the marker set that was worn"
        doubts = {"doubts": [text]}
    worn = worn or max(int(shown[int(_SETTINGS.worn_share * len(shown))]), 1)
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
        **doubts,
    }

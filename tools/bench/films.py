"""Takes filmed by simulated cameras: right labels, and the cost of the video."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import Database
from perfanim.core.geometry.arrays import Array, Mask, runs
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_frame_codec import pack, unpack
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import motion_of, solve_frames, solve_take
from perfanim.core.simulate.calibrated_studio import calibrate_studio, studio_on_floor
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import SimulatedSource, simulated_source
from perfanim.core.simulate.studio.stage_placement import on_stage, with_poses
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.studio_settings import StudioSettings
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import Progress
from perfanim.core.vision.pipeline import MarkerPipeline

from .data import BOXING, CMU, LEFT_OUT, SPLIT, TestTake, read_take, without_subject, without_tests
from .end_to_end import EMPTY_FRAMES, EXPOSURE_S, MARKER_SET, on_treadmill
from .figure6 import degrees_per_joint, true_subject
from .methods import default_settings

FRAMES = 300  # of a film, at most, after the T pose
_T_POSE_S = 0.5
_RIGHT_M = 0.03  # a located marker is right so near its true place
_EPISODES = 5  # of a film that are listed


class Film(NamedTuple):
    """A take to film, by a subject of the database or unseen."""

    take: TestTake
    unseen: bool = False


FILMS = (
    Film(TestTake("walking (07_02)", "07_02")),
    Film(TestTake("jumping forward (16_06), subject unseen", "16_06"), unseen=True),
    Film(replace(BOXING, title="boxing (14_02, 5th sixth)", last=5 / 6)),
    Film(TestTake("dance (05_09)", "05_09")),
    Film(TestTake("walking (05_01), subject unseen", "05_01"), unseen=True),
    Film(TestTake("running (09_02)", "09_02")),
    Film(TestTake("mopping, both hands on a stick (14_13)", "14_13")),
    Film(replace(BOXING, title="boxing (14_02, 6th sixth)", first=5 / 6)),
)


@dataclass(frozen=True)
class Filmed:
    """Marker frames of a film and their truth.

    Args:
        truth: the motion, T pose included.
        markers_m: (F, M, 3) true places.
        both: (F, M) which markers both cameras show.
        start: first frame after the T pose and the way from it.
    """

    frames: list[MarkerFrame]
    truth: Motion
    markers_m: Array
    both: Mask
    start: int
    rig: CameraRig


def play_films(
    data: Path, whole: Database, out: Path, count: int, progress: Progress
) -> Iterator[tuple[dict[str, Any], list[dict[str, Any]]]]:
    """Film, track and solve takes; yield the row and worst episodes of each.

    The body is known, so that a row gives the cost of images, stereo and labels.
    """
    rig: CameraRig | None = None
    for film in FILMS[:count]:
        progress(0.0, f"{film.take.title}: filming, tracking and solving")
        motion = read_take(data, film.take)
        source, start = _staged(motion)
        rig = rig or studio_on_floor(calibrate_studio(source).rig, source)
        database = _database_for(film, whole, out / "databases")
        yield film_row(
            film, film_take(source, start, rig), database, default_settings(out, subject_of(film.take.trial))
        )


def _database_for(film: Film, whole: Database, folder: Path) -> Database:
    trial = film.take.trial
    if film.unseen:
        return without_subject(whole, folder, subject_of(trial))
    if trial in (*LEFT_OUT, SPLIT):
        return without_tests(whole, folder / f"{CMU}-without-tests.pfdb")
    return without_tests(whole, folder / f"{CMU}-without-{trial}.pfdb", lambda clip: clip.name != trial)


def _staged(motion: Motion) -> tuple[SimulatedSource, int]:
    """Return a source of the middle of a motion after a T pose, and its start."""
    first = max((motion.frames - FRAMES) // 2, 0)
    shown = on_stage(on_treadmill(sliced(motion, first, min(first + FRAMES, motion.frames))))
    staged = with_poses(shown, ("t",), _T_POSE_S)
    studio = Renderer(default_rig(), StudioSettings(exposure_s=EXPOSURE_S))
    return simulated_source(staged, MARKER_SET, studio), staged.frames - shown.frames


def film_take(source: SimulatedSource, start: int, rig: CameraRig) -> Filmed:
    """Return the marker frames that a rig makes of a source, with their truth."""
    pipeline = MarkerPipeline(rig)
    pipeline.learn_empty(source.background_frames(EMPTY_FRAMES))
    frames, markers, both = [], [], []
    for images in source:
        frames.append(pipeline.process(images))
        markers.append(images.truth.markers_m)
        both.append(images.truth.visible.all(axis=0))
    truth = sliced(source.motion, 0, len(frames))
    return Filmed(frames, truth, np.array(markers), np.array(both), start, rig)


def film_row(
    film: Film, filmed: Filmed, database: Database, settings: SolveSettings
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the row of a film, and the episodes with most wrong labels.

    `shown_true` has the true markers as far as both cameras show them: the rest of the cost is not that of occlusion.
    """
    subject, start = true_subject(filmed.truth), filmed.start
    take, _ = simulate_markers(filmed.truth, subject)
    located = replace(take, positions_m=np.where(filmed.both[..., None], take.positions_m, np.nan))
    exact, shown = (
        solve_take(each, subject, database, settings, lambda fraction, text: None, causal=True).motion
        for each in (take, located)
    )
    session = MultiTargetSession([Session(subject, database, filmed.rig, settings)])
    tracked = [session.step(frame).performers[0] for frame in filmed.frames]
    stored = [unpack(pack(frame)) for frame in filmed.frames]  # as a take holds them
    later = []
    for causal in (True, False):
        session.reset()
        later.append(solve_frames(stored, session, film.take.title, lambda f, text: None, causal=causal).poses_of())
    observed, causal_m, recorded_m = (np.array([pose.observed_m for pose in poses]) for poses in (tracked, *later))
    named = np.isfinite(observed[..., 0])
    right = _is_right(observed, filmed)
    wrong = (named & ~right)[start:]
    both = filmed.both[start:]
    errors = [
        degrees_per_joint(motion, filmed.truth)[start:]
        for motion in (exact, shown, motion_of(tracked, subject, "video", filmed.truth.fps))
    ]
    true_deg, shown_deg, video_deg = (float(error.mean()) for error in errors)
    row = {
        "film": film.take.title,
        "unseen": film.unseen,
        "frames": len(both),
        "visible_marker_frames": int(both.sum()),
        "right_share": round(float(right[start:][both].mean()), 5),
        "recorded_right_share": round(float(_is_right(recorded_m, filmed)[start:][both].mean()), 5),
        "wrong_marker_frames": int(wrong.sum()),
        "true_deg_per_joint": round(true_deg, 4),
        "shown_true_deg_per_joint": round(shown_deg, 4),
        "video_deg_per_joint": round(video_deg, 4),
        "cost_deg": round(video_deg - true_deg, 4),
        "cost_share": round(video_deg / true_deg - 1.0, 4),
        "offline_other_frames": int(np.sum(~np.isclose(observed, causal_m, 0.0, 1e-9, True).all(axis=(1, 2)))),
    }
    missed = both & ~right[start:]
    return row, _episodes(film, filmed, missed | wrong, errors[2] - errors[0], wrong)


def _is_right(observed_m: Array, filmed: Filmed) -> Mask:
    """Return whether each marker (F, M) is located at its true place."""
    return np.asarray(np.linalg.norm(observed_m - filmed.markers_m, axis=-1) < _RIGHT_M)


def film_summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows (check, value, goal) on films."""
    if not rows:
        return []
    known, unseen = ([row for row in rows if row["unseen"] == is_unseen] for is_unseen in (False, True))
    checks = [
        ("right, least share of markers that both cameras show", min(row["right_share"] for row in rows), ">= 0.995"),
        ("the same, recorded", min(row["recorded_right_share"] for row in rows), ">= 0.995"),
        ("wrong markers in all frames", sum(row["wrong_marker_frames"] for row in rows), "0"),
        ("live and recorded differ, frames", sum(row["offline_other_frames"] for row in rows), "0"),
    ]
    checks += (
        [("cost, known subjects, deg per joint", max(row["cost_deg"] for row in known), "<= 0.2")] if known else []
    )
    checks += [("cost, unseen subjects, share", max(row["cost_share"] for row in unseen), "<= 0.05")] if unseen else []
    return [{"check": f"{len(rows)} films: {check}", "value": value, "goal": goal} for check, value, goal in checks]


def _episodes(film: Film, filmed: Filmed, bad: Mask, cost_deg: Array, wrong: Mask) -> list[dict[str, Any]]:
    """Return the runs of frames with most markers that are wrong or not found."""
    names = true_subject(filmed.truth).marker_set.names
    episodes: list[dict[str, Any]] = []
    for begin, stop in runs(bad.any(axis=1)):
        frames = slice(begin, stop)
        markers = [
            f"{names[marker]} {'wrong' if wrong[frames, marker].any() else 'not found'}"
            for marker in np.flatnonzero(bad[frames].any(axis=0))
        ]
        episodes.append(
            {
                "film": film.take.title,
                "frame": filmed.start + begin,
                "frames": stop - begin,
                "marker_frames": int(bad[frames].sum()),
                "markers": ", ".join(markers),
                "cost_deg": round(float(cost_deg[frames].mean()), 3),
            }
        )
    return sorted(episodes, key=lambda episode: -episode["marker_frames"])[:_EPISODES]

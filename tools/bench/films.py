"""Takes filmed by simulated cameras: share of correct labels, and the loss of accuracy caused by video."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from perfanim.core.body.motion import sliced
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.header_facts import Clip
from perfanim.core.database.store import Database
from perfanim.core.geometry.arrays import Array, Mask
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_frame_codec import pack, unpack
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import solve_frames, solve_take
from perfanim.core.session.steady_motion import motion_of
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import no_progress

from .end_to_end import Filmed, calibrated, film, staged
from .run import Run
from .scenarios import FILMED, LEFT_OUT, SPLIT
from .solving import degrees_per_joint, true_subject

_FRAMES = 300  # largest number of frames in a video, after the T pose
_T_POSE_S = 0.5
_RIGHT_M = 0.03  # largest distance of a correctly labelled marker from its true position


def play_films(run: Run, whole: Database, count: int) -> Iterator[dict[str, Any]]:
    """Film, track and solve takes; yield one row per take.

    The body is known, so a row shows the loss caused by images, stereo and labels.
    """
    rig: CameraRig | None = None
    for take, unseen in FILMED[:count]:
        run.progress(0.95, f"{take.title}: filming, tracking and solving")
        motion, subject = run.read(take), subject_of(take.trial)
        first = max((motion.frames - _FRAMES) // 2, 0)
        source, start = staged(sliced(motion, first, min(first + _FRAMES, motion.frames)), ("t",), _T_POSE_S)
        rig = rig or calibrated(source)
        if unseen:
            database = run.without_subject(whole, subject)
        elif take.trial in (*LEFT_OUT, SPLIT):
            database = run.without_tests(whole)
        else:
            database = run.without_tests(whole, f"cmu-without-{take.trial}", _without(take.trial))
        row = film_row(film(source, rig), start, rig, database, run.settings_for(subject))
        cost = {"unseen_cost_share": row["cost_share"]} if unseen else {"known_cost_deg": row["cost_deg"]}
        row |= {"known_cost_deg": None, "unseen_cost_share": None} | cost
        yield {"film": take.title, "unseen": unseen} | row


def _without(trial: str) -> Callable[[Clip], bool]:
    return lambda clip: clip.name != trial


def film_row(filmed: Filmed, start: int, rig: CameraRig, database: Database, settings: SolveSettings) -> dict[str, Any]:
    """Return the figures for a video from frame `start` on.

    `shown_true` has the true markers where both cameras show them: the rest of the loss is not caused by occlusion.
    """
    subject, truth = true_subject(filmed.truth), filmed.truth
    take, _ = simulate_markers(truth, subject)
    located = replace(take, positions_m=np.where(filmed.both[..., None], take.positions_m, np.nan))
    exact, shown = (
        solve_take(each, subject, database, settings, no_progress, causal=True).motion for each in (take, located)
    )
    session = MultiTargetSession([Session(subject, database, rig, settings)])
    tracked = [session.step(frame).performers[0] for frame in filmed.frames]
    stored = [unpack(pack(frame)) for frame in filmed.frames]  # as a take stores them
    later = []
    for causal in (True, False):
        session.reset()
        later.append(solve_frames(stored, session, truth.name, no_progress, causal=causal).poses_of())
    observed, causal_m, recorded_m = (np.array([pose.observed_m for pose in poses]) for poses in (tracked, *later))
    right = _is_right(observed, filmed)
    wrong = (np.isfinite(observed[..., 0]) & ~right)[start:]
    both = filmed.both[start:]
    video = motion_of(tracked, subject, "video", truth.fps)
    errors = [degrees_per_joint(motion, truth)[start:] for motion in (exact, shown, video)]
    true_deg, shown_deg, video_deg = (float(error.mean()) for error in errors)
    return {
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


def _is_right(observed_m: Array, filmed: Filmed) -> Mask:
    """Return whether each marker (F, M) is located at its true position."""
    return np.asarray(np.linalg.norm(observed_m - filmed.markers_m, axis=-1) < _RIGHT_M)

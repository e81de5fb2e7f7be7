"""People without markers whose truth is known: their points with a network's errors, in films of two cameras."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.api import fit_subject
from perfanim.core.body.body_parts import PARTS
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import open_database
from perfanim.core.geometry.arrays import IntArray, Mask, runs
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.exchanged_throughout import other_sides
from perfanim.core.markers.label_faults import correct_labels
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_keypoints import KeypointErrors, keypoint_errors
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import no_progress
from perfanim.core.vision.people.body_network import BlazePose
from perfanim.core.vision.people.people_pipeline import LocateSettings, PersonLocator
from perfanim.core.vision.tracked_take import labelled_take

from .rendered_person import in_the_middle, two_cameras
from .run import Run
from .scenarios import CMU, LIVE, OFFLINE, PEOPLE_TAKES
from .solving import SKATE, feet_errors, true_subject
from .tables import mean

_POINTS = load_marker_set(BlazePose.marker_set)
_OTHERS = other_sides(_POINTS.markers)
# of each camera's points: 30 mm, 17 mm along each axis, as measured (see docs/tuning-log.md, "Cameras by a walk")
_ERRORS = KeypointErrors(slow_m=0.030 / np.sqrt(3.0), fast_m=0.006)
_MEASURES = ("mpjpe_mm", "bone_direction_deg", "jitter_ratio")
# joints that show on which side a limb is
_LIMBS = (("radius", "wrist"), ("tibia", "foot"))
_COUNTS = ("frames", "exchanged", "exchanged_long")  # see `_counted`


@dataclass(frozen=True)
class FilmSettings:
    """The films, and what a network does to them besides its errors."""

    fps: float = 30.0
    seconds: float = 4.0  # of each take, at most
    beyond_m: float = 2.5  # distance of the cameras from the place nearest to them
    exchanged: float = 0.2  # share of one camera's pictures that show arms, legs or both exchanged
    exchanged_frames: tuple[int, int] = (5, 15)  # how many in a row
    missing: float = 0.05  # share of the points that a picture does not show
    crop: float = 1.3  # side of a crop in units of the body's extent in the picture
    passes: int = 11  # draws of all errors in which left and right are decided; the first one is solved
    long_s: float = 0.1  # time for which a limb may be on the other side


_S = FilmSettings()


def simulated_people(run: Run) -> dict[str, Any]:
    """Solve people whom neither the database nor the prior knows, live and offline, and count exchanged limbs.

    The body is fitted to the points of the film. It is compared with exact markers on a measured body, solved the same
    way.

    Returns:
        rows (take, way, frames, errors, share of the bones' errors with exact markers, feet, frames with a limb on the
        other side), means (over the takes, by way), and exchanges (way: frames in which left and right were decided;
        those with a limb on the other side; those for longer than a tenth of a second).
    """
    whole, people = run.whole(CMU), {subject_of(take.trial) for take in PEOPLE_TAKES}
    kept = [(clip, 0, clip.stop - clip.start) for clip in whole.clips if clip.subject not in people]
    path = run.subset(whole, "cmu-without-people", kept).path
    jobs = {}
    for number, take in enumerate(PEOPLE_TAKES):
        truth = resampled(run.read(take), _S.fps)
        truth = in_the_middle(sliced(truth, 0, min(truth.frames, round(_S.seconds * _S.fps))))
        jobs[take.title] = (take.title, truth, path, run.settings_for(subject_of(take.trial)), number)
    solved = run.each("simulated-people", _solve, jobs, lambda done: done[0])
    rows, decided = ([row for each in solved for row in each[part]] for part in (0, 1))
    means = [
        {"way": way, "takes": len(of)} | {name: mean(of, name) for name in of[0] if name not in ("take", "way")}
        for way in (LIVE, OFFLINE)
        if (of := [row for row in rows if row["way"] == way])
    ]
    exchanges = [
        {"way": way} | {name: sum(row[name] for row in decided if row["way"] == way) for name in _COUNTS}
        for way in (LIVE, OFFLINE)
    ]
    tables = {"": rows, "means": means, "exchanges": exchanges}
    return run.write("simulated-people", {"rows": rows, "means": means, "exchanges": exchanges}, tables)


def _solve(
    title: str, truth: Motion, database: Path, settings: SolveSettings, number: int
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return a take's rows, and its counts of exchanged limbs in all passes, in another process."""
    opened, rows, decided = open_database(database), [], []
    rig = two_cameras(_far_m(truth))
    exact, _ = simulate_markers(truth, true_subject(truth))
    for seed in range(_S.passes):
        frames, right = film(truth, rig, np.random.default_rng((number, seed)))
        live, whole = PersonLocator(rig, _POINTS), PersonLocator(rig, _POINTS)
        located = {LIVE: [live.locate(frame) for frame in frames], OFFLINE: whole.locate_all(frames)}
        decided += [{"way": way} | _counted(_misplaced(found, right)) for way, found in located.items()]
        if seed:
            continue
        takes = {way: labelled_take(found, _POINTS.names, truth.name, truth.fps, rig) for way, found in located.items()}
        subject = fit_subject(takes[OFFLINE], opened)
        takes[OFFLINE], _ = correct_labels(takes[OFFLINE], subject)
        for way, take in takes.items():
            causal = way == LIVE
            motion = solve_take(take, subject, opened, settings, no_progress, causal=causal).motions[0]
            marked = solve_take(exact, true_subject(truth), opened, settings, no_progress, causal=causal).motions[0]
            errors, marked_errors = evaluate(motion, truth), evaluate(marked, truth)
            counts = _counted(crossed_limbs(motion, truth).any(axis=1))
            rows.append(
                {"take": title, "way": way}
                | {name: round(errors[name], 3) for name in _MEASURES}
                | {"of_exact": round(errors["bone_direction_deg"] / marked_errors["bone_direction_deg"], 3)}
                | {SKATE: feet_errors(motion, truth, noise_of(_POINTS.points).lasting_m)[SKATE]}
                | counts
            )
    return rows, decided


def film(motion: Motion, rig: CameraRig, random: np.random.Generator) -> tuple[list[MarkerFrame], IntArray]:
    """Return what a network finds in the films of a motion, and the truth.

    One camera shows arms, legs, or both exchanged for some frames in a row.

    Returns:
        Frames like those of `PeoplePipeline.detect`, and the index (F, C, K) of the network's point that is each point.
    """
    points_m = simulate_markers(motion, _POINTS)[0].positions_m
    (frames, count), cameras = points_m.shape[:2], len(rig)
    rows_of = np.tile(np.arange(count), (frames, cameras, 1))
    camera, limbs = random.integers(cameras), _limb_points()
    while np.mean((rows_of[:, camera] != np.arange(count)).any(axis=1)) < _S.exchanged:
        first, length = random.integers(frames), random.integers(*_S.exchanged_frames, endpoint=True)
        own = limbs[random.integers(len(limbs))]
        rows_of[first : first + length, camera, own] = _OTHERS[own]
    blobs = []
    for c, each in enumerate(rig.cameras):
        found_m = points_m + keypoint_errors(frames, count, motion.fps, random, _ERRORS)
        pixels = each.project(found_m.reshape(-1, 3)).reshape(frames, count, 2)
        rows = np.zeros((frames, count, 5), dtype=np.float32)
        rows[..., :2] = np.take_along_axis(pixels, rows_of[:, c, :, None], axis=1)
        sides_px = _S.crop * np.ptp(pixels, axis=1).max(axis=-1)
        rows[..., 2] = LocateSettings().error_share * sides_px[:, None]
        rows[..., 3] = np.where(random.random((frames, count)) < _S.missing, 0.0, 255.0)
        blobs.append(rows)
    seen = [
        MarkerFrame(
            n, n / motion.fps, blobs=tuple(rows[n] for rows in blobs), camera_times_s=np.full(cameras, n / motion.fps)
        )
        for n in range(frames)
    ]
    return seen, rows_of


def _limb_points() -> list[IntArray]:
    """Return the points of the arms, of the legs, and of both."""
    paired = (_OTHERS >= 0) & (np.arange(len(_OTHERS)) != _OTHERS)
    sides = [
        {joint for side in ("left", "right") for part in parts for joint in PARTS[f"{side} {part}"]}
        for parts in (("arm", "hand"), ("leg", "foot"))
    ]
    members = [np.flatnonzero(paired & [marker.joint in own for marker in _POINTS.markers]) for own in sides]
    return [*members, np.concatenate(members)]


def _misplaced(found: Sequence[MarkerFrame], right: IntArray) -> Mask:
    """Return the frames (F,) in which a limb's point was located with another point's row in a picture."""
    limbs = _limb_points()[-1]
    return np.array([
        np.any((seen.point_blobs >= 0) & (seen.point_blobs != rows[:, seen.labels].T), axis=1)[
            np.isin(seen.labels, limbs)
        ].any()
        for seen, rows in zip(found, right, strict=True)
    ])  # fmt: skip


def crossed_limbs(motion: Motion, truth: Motion) -> Mask:
    """Return the frames (F, 2) in which arms, and legs, are nearer to the other side's than to their own of the truth.

    The truth has at least the motion's frames, and the same joints.
    """
    own_m, true_m = (
        forward_kinematics(each.skeleton, each.rotations, each.root_positions_m)[0] for each in (motion, truth)
    )
    crossed = []
    for limb in _LIMBS:
        sides = [[truth.skeleton.index(side + name) for name in limb] for side in "lr"]
        ordered, other = (
            np.linalg.norm(own_m[:, sides] - true_m[: len(own_m), order], axis=-1).sum(axis=(1, 2))
            for order in (sides, sides[::-1])
        )
        crossed.append(other < ordered)
    return np.stack(crossed, axis=1)


def _counted(wrong: Mask) -> dict[str, int]:
    """Return the number of frames, of wrong ones, and of those in a row that lasts too long."""
    long = [stop - first for first, stop in runs(wrong) if stop - first > _S.long_s * _S.fps]
    return dict(zip(_COUNTS, (len(wrong), int(wrong.sum()), sum(long)), strict=True))


def _far_m(motion: Motion) -> float:
    """Return how far from the middle the cameras stand, so that nobody comes near them."""
    joints_m = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]
    return _S.beyond_m + float(np.linalg.norm(joints_m[..., ::2], axis=-1).max())

"""The default settings with markers that are noisy, missing, slow or fast."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.store import Database
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_set import PointKind, load_marker_set
from perfanim.core.markers.marker_take import MarkerTake, SingleViews
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.simulated_keypoints import KeypointErrors, keypoint_errors
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.solver.marker_selection import choose_markers, with_markers
from perfanim.core.solver.settings import SolveSettings

from .run import Rows
from .scenarios import CLEAN, LIVE, OFFLINE, Disturbance
from .solving import DEEPEST, SKATE, Expected, Way, expected_of, feet_errors, first_pose, solve_both_ways, true_subject
from .tables import geometric_mean, groups, mean

SEEDS = (0, 1, 2)
MEASURES = (
    "deg_per_joint", "deg_per_angle", "mpjpe_mm", "bone_direction_deg", "main_bone_direction_deg", "twist_deg",
    "root_position_mm", "root_rotation_deg", "jitter_ratio", "foot_skate_cm_s",
)  # fmt: skip
_WAITED = "waited_s"  # time until the first live pose
_RATIOS = ("deg_per_joint", "mpjpe_mm", "bone_direction_deg", "main_bone_direction_deg", "jitter_ratio", "of_clean")
_FARTHER, _PIXELS = 2.0, 0.2  # for one-camera views: factor on the studio's distance, noise of a centre, px
_WILD_M = 0.05, 0.17  # distances of wild points
_GAP_FRAMES, _GAP_SHARES = (1, 2, 3, 5), (0.8, 0.1, 0.05, 0.05)  # lengths of gaps of markers that flicker
_HIDDEN, _HIDDEN_S = "LHAN", (1.0, 1.5)  # the marker that is hidden, and when
_SUIT, _WORN = "cmu-41", 9  # marker set of a suit, and the number of its markers that are worn
_KEYPOINTS = KeypointErrors(slow_m=0.03)
_EXCHANGED, _EXCHANGED_FRAMES = (("LHAN", "RHAN"), ("LFOO", "RFOO")), (5, 15)  # keypoints that change sides, how long


def disturbed_take(
    disturbance: Disturbance, truth: Motion, seed: int, subject: Subject | None = None
) -> tuple[MarkerTake, Motion]:
    """Return the disturbed markers of a motion, and the motion at their rate.

    Args:
        subject: Whose markers they are; by default the benchmarks' on the true body.
    """
    if disturbance.fps:
        truth = resampled(truth, disturbance.fps)
    worn = subject or true_subject(truth)
    take, _ = simulate_markers(truth, worn, disturbance.noise_mm, disturbance.dropout, seed)
    if disturbance.flicker or disturbance.wild:
        take = _flickering(take, disturbance, np.random.default_rng(seed))
    if disturbance.keypoints:
        take = _as_keypoints(take, np.random.default_rng(seed))
    if disturbance.rays:
        whole, _ = simulate_markers(truth, true_subject(truth))
        return replace(take, single=_by_one_camera(take, whole, seed)), truth
    if disturbance.hides:
        positions = take.positions_m.copy()
        first, last = (round(second * truth.fps) for second in _HIDDEN_S)
        positions[first:last, take.names.index(_HIDDEN)] = np.nan
        take = replace(take, positions_m=positions)
    return take, truth


def worn_subject(disturbance: Disturbance, truth: Motion, database: Database) -> Subject:
    """Return the true body with the points that a disturbance solves it from."""
    if disturbance.suit:
        suit = Subject(truth.name, truth.skeleton, load_marker_set(_SUIT))
        return with_markers(suit, choose_markers(suit, database, _WORN).names)
    return true_subject(truth, PointKind.KEYPOINTS if disturbance.keypoints else PointKind.MARKERS)


def _flickering(take: MarkerTake, disturbance: Disturbance, generator: np.random.Generator) -> MarkerTake:
    """Return the take with wild points and short gaps, four in five of which are a single frame long."""
    positions, shape = take.positions_m.copy(), take.positions_m.shape[:2]
    ways = generator.normal(size=(*shape, 3))
    ways *= generator.uniform(*_WILD_M, (*shape, 1)) / np.linalg.norm(ways, axis=-1, keepdims=True)
    wild = generator.random(shape) < disturbance.wild
    positions[wild] += ways[wild]
    mean = float(np.dot(_GAP_FRAMES, _GAP_SHARES))
    for first, marker in np.argwhere(generator.random(shape) < disturbance.flicker / mean):
        positions[first : first + generator.choice(_GAP_FRAMES, p=_GAP_SHARES), marker] = np.nan
    return replace(take, positions_m=positions)


def _as_keypoints(take: MarkerTake, generator: np.random.Generator) -> MarkerTake:
    """Return the take with the errors of keypoints, and each pair exchanged once in either half."""
    frames, count = take.positions_m.shape[:2]
    positions = take.positions_m + keypoint_errors(frames, count, take.fps, generator, _KEYPOINTS)
    least, most = _EXCHANGED_FRAMES
    for pair in _EXCHANGED:
        left, right = map(take.names.index, pair)
        for half in (0, frames // 2):
            first = half + generator.integers(max(frames // 2 - most, 1))
            part = slice(first, first + generator.integers(least, most + 1))
            positions[part, [left, right]] = positions[part, [right, left]]
    return replace(take, positions_m=positions)


def _by_one_camera(take: MarkerTake, whole: MarkerTake, seed: int) -> SingleViews:
    """Return views of the markers that a take lacks, each from one camera."""
    middle_m = np.nanmean(take.positions_m, axis=(0, 1))
    cameras = tuple(
        replace(camera, translation_m=_FARTHER * camera.translation_m - camera.rotation @ (middle_m * (1, 0, 1)))
        for camera in default_rig().cameras
    )
    generator, missing = np.random.default_rng(seed), np.isnan(take.positions_m[..., 0])
    of_marker = generator.permutation(len(take.names)) % len(cameras)
    points = np.full((*missing.shape, 2), np.nan)
    for number, camera in enumerate(cameras):
        seen = missing & (of_marker == number)
        pixels = camera.project(whole.positions_m[seen])
        points[seen] = camera.undistort(pixels + generator.normal(0.0, _PIXELS, pixels.shape))
    chosen = np.where(missing & np.isfinite(points[..., 0]), of_marker, -1)
    return SingleViews(CameraRig(cameras), chosen, np.where(chosen[..., None] < 0, np.nan, points))


class DisturbedTake(NamedTuple):
    """A take solved with each disturbance."""

    rows: list[
        dict[str, Any]
    ]  # errors by disturbance and mode, means over the seeds, and their ratios to the clean ones
    clean: Mapping[str, Way]  # solved from exact markers, by mode
    expected: dict[tuple[str, str], list[Expected]]  # expected and actual errors, by disturbance and mode, one per seed


def solve_disturbed(
    truth: Motion,
    database: Database,
    settings: SolveSettings,
    disturbances: Sequence[Disturbance],
    seeds: Sequence[int] = SEEDS,
    others: Mapping[str, Callable[[MarkerTake], Motion]] | None = None,
) -> DisturbedTake:
    """Solve a take live and offline with each disturbance, the clean take first.

    Disturbances without randomness are solved once. Errors count from the first live pose on: before it, too few
    markers show where the body is.

    Args:
        others: Further ways to solve a take, by name; they get no views of single cameras and no suits.
    """
    rows: list[dict[str, Any]] = []
    clean: Mapping[str, Way] = {}
    expected: dict[tuple[str, str], list[Expected]] = {}
    for disturbance in disturbances:
        further = {} if disturbance.rays or disturbance.suit else others or {}
        subject = worn_subject(disturbance, truth, database)
        found: dict[str, list[dict[str, Any]]] = {way: [] for way in (LIVE, OFFLINE, *further)}
        for seed in seeds if disturbance.is_random else seeds[:1]:
            take, moved = disturbed_take(disturbance, truth, seed, subject)
            ways = solve_both_ways(take, subject, database, settings)
            clean = clean or ways
            first, last = first_pose(ways[LIVE].poses), moved.frames
            seen = sliced(moved, first, last)
            motions = {way: solved.motion for way, solved in ways.items()}
            motions |= {way: solve(take) for way, solve in further.items()}
            for way, whole in motions.items():
                motion = sliced(whole, first, last)
                found[way].append(evaluate(motion, seen) | feet_errors(motion, seen) | {_WAITED: first / moved.fps})
            for way, solved in ways.items():
                expected.setdefault((disturbance.name, way), []).append(expected_of(solved.poses[first:], seen))
        for way, errors in found.items():
            of = {"disturbance": disturbance.name, "way": way}
            means = {
                unit: round(float(np.mean([each[unit] for each in errors])), 4) for unit in (*MEASURES, SKATE, _WAITED)
            }
            rows.append(of | means | {DEEPEST: max(error[DEEPEST] for error in errors)})
    by_way = {row["way"]: row["deg_per_joint"] for row in rows if row["disturbance"] == CLEAN.name}
    rows = [row | {"of_clean": round(row["deg_per_joint"] / by_way[row["way"]], 4)} for row in rows]
    return DisturbedTake(rows, clean, expected)


def disturbed_means(rows: Rows, conditions: Sequence[str]) -> list[dict[str, Any]]:
    """Return means by condition, disturbance and mode.

    They are geometric for errors and ratios, plain for skating, and maxima for the largest ratio and depth.
    """
    found, means = groups(rows, "condition", "disturbance", "way"), []
    for condition in conditions:
        for name, way in groups(rows, "disturbance", "way"):
            if not (of := found.get((condition, name, way))):
                continue
            means.append(
                {"condition": condition, "disturbance": name, "way": way, "takes": len(of)}
                | {unit: round(geometric_mean([row[unit] for row in of]), 4) for unit in _RATIOS}
                | {"worst_of_clean": max(row["of_clean"] for row in of)}
                | {SKATE: mean(of, SKATE)}
                | {f"most_{SKATE}": max([row[SKATE] for row in of if np.isfinite(row[SKATE])], default=float("nan"))}
                | {DEEPEST: max(row[DEEPEST] for row in of)}
            )
    return means

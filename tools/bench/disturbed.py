"""The default settings on markers that are noisy, missing, slow or fast."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.store import Database
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_take import MarkerTake, SingleViews
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.solver.settings import SolveSettings

from .calibration import Expected, expected_of
from .feet import feet_errors
from .figure6 import true_subject
from .paired import geometric_mean
from .report import Rows
from .solved_takes import LIVE, OFFLINE, Way, first_pose, solve_both_ways

SEEDS = (0, 1, 2)
_FARTHER, _PIXELS = 2.0, 0.2  # of one camera's views: the studio's distance times so much, noise of a centre
_HIDDEN, _HIDDEN_S = "LHAN", (1.0, 1.5)  # the marker that is gone, and when
MEASURES = (
    "deg_per_joint",
    "deg_per_angle",
    "mpjpe_mm",
    "bone_direction_deg",
    "main_bone_direction_deg",
    "twist_deg",
    "root_position_mm",
    "root_rotation_deg",
    "jitter_ratio",
    "foot_skate_cm_s",
)
_SKATE, _DEEPEST = "skate_beyond_cm_s", "toes_below_mm"  # see feet_errors
_WAITED = "waited_s"  # until the first live pose
_RATIOS = ("deg_per_joint", "mpjpe_mm", "bone_direction_deg", "main_bone_direction_deg", "jitter_ratio")


@dataclass(frozen=True)
class Disturbance:
    """Faults of the markers of a take.

    Args:
        noise_mm: standard deviation of each coordinate.
        dropout: share of marker positions that are missing.
        hides: whether one hand's marker is gone for half a second, too.
        rays: whether one of two cameras sees each marker that is missing.
        fps: rate; 0 as the take.
    """

    name: str
    noise_mm: float = 0.0
    dropout: float = 0.0
    hides: bool = False
    rays: bool = False
    fps: float = 0.0

    def take_of(self, truth: Motion, seed: int) -> tuple[MarkerTake, Motion]:
        """Return the disturbed markers of a motion, and the motion at their rate."""
        if self.fps:
            truth = resampled(truth, self.fps)
        take, _ = simulate_markers(truth, true_subject(truth), self.noise_mm, self.dropout, seed)
        if self.rays:
            whole, _ = simulate_markers(truth, true_subject(truth))
            return replace(take, single=_by_one_camera(take, whole, seed)), truth
        if not self.hides:
            return take, truth
        positions = take.positions_m.copy()
        first, last = (round(second * truth.fps) for second in _HIDDEN_S)
        positions[first:last, take.names.index(_HIDDEN)] = np.nan
        return replace(take, positions_m=positions), truth


def _by_one_camera(take: MarkerTake, whole: MarkerTake, seed: int) -> SingleViews:
    """Return views of the markers that a take lacks, each by one camera."""
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


CLEAN = Disturbance("clean")
DISTURBANCES = (
    CLEAN,
    Disturbance("1 mm", noise_mm=1.0),
    Disturbance("3 mm", noise_mm=3.0),
    Disturbance("10 % lost", dropout=0.1),
    Disturbance("30 % lost, a hand for 0.5 s", dropout=0.3, hides=True),
    Disturbance("30 % by one camera", dropout=0.3, rays=True),
    Disturbance("30 Hz", fps=30.0),
    Disturbance("120 Hz", fps=120.0),
)
_QUICK_NAMES = ("clean", "3 mm", "30 % lost, a hand for 0.5 s", "30 % by one camera")
QUICK = tuple(each for each in DISTURBANCES if each.name in _QUICK_NAMES)


@dataclass(frozen=True)
class DisturbedTake:
    """A take solved with each disturbance.

    Args:
        rows: errors by disturbance and way, means over the seeds, and their ratios to the clean ones.
        joints: the same by joint.
        clean: as solved from exact markers, by way.
        expected: errors beside the expected ones, by disturbance and way, one entry a seed.
    """

    rows: list[dict[str, Any]]
    joints: list[dict[str, Any]]
    clean: Mapping[str, Way]
    expected: Mapping[tuple[str, str], list[Expected]]


def solve_disturbed(
    truth: Motion,
    database: Database,
    settings: SolveSettings,
    disturbances: Sequence[Disturbance] = DISTURBANCES,
    seeds: Sequence[int] = SEEDS,
) -> DisturbedTake:
    """Solve a take live and offline with each disturbance, the clean one first.

    What has no chance in it is solved once. Errors are those from the first live pose on: before it too few markers
    show where the body is.
    """
    subject = true_subject(truth)
    rows: list[dict[str, Any]] = []
    joints: list[dict[str, Any]] = []
    clean: Mapping[str, Way] = {}
    expected: dict[tuple[str, str], list[Expected]] = {}
    for disturbance in disturbances:
        found: dict[str, list[dict[str, Any]]] = {LIVE: [], OFFLINE: []}
        for seed in seeds if disturbance.noise_mm or disturbance.dropout else seeds[:1]:
            take, moved = disturbance.take_of(truth, seed)
            ways = solve_both_ways(take, subject, database, settings)
            clean = clean or ways
            first, last = first_pose(ways[LIVE].poses), moved.frames
            seen = sliced(moved, first, last)
            for way, solved in ways.items():
                motion = sliced(solved.motion, first, last)
                found[way].append(evaluate(motion, seen) | feet_errors(motion, seen) | {_WAITED: first / moved.fps})
                expected.setdefault((disturbance.name, way), []).append(expected_of(solved.poses[first:], seen))
        for way, errors in found.items():
            of = {"disturbance": disturbance.name, "way": way}
            rows.append(of | _means_of(errors))
            joints += [of | row for row in _joint_means(errors)]
    by_way = {row["way"]: row["deg_per_joint"] for row in rows if row["disturbance"] == CLEAN.name}
    rows = [row | {"of_clean": round(row["deg_per_joint"] / by_way[row["way"]], 4)} for row in rows]
    return DisturbedTake(rows, joints, clean, expected)


def _means_of(errors: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return the means of errors over seeds; of toes below the floor the deepest."""
    means = {unit: round(float(np.mean([error[unit] for error in errors])), 4) for unit in (*MEASURES, _SKATE, _WAITED)}
    return means | {_DEEPEST: max(error[_DEEPEST] for error in errors)}


def _joint_means(errors: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return [
        {"joint": joint}
        | {unit: round(float(np.mean([error["per_joint"][joint][unit] for error in errors])), 3) for unit in units}
        for joint, units in errors[0]["per_joint"].items()
    ]


def disturbed_means(rows: Rows, conditions: Sequence[str]) -> list[dict[str, Any]]:
    """Return means by condition, disturbance and way.

    Geometric ones of errors and ratios, the plain one of skating, and the largest ratio and depth.
    """
    means = []
    for condition in conditions:
        for name, way in dict.fromkeys((row["disturbance"], row["way"]) for row in rows):
            of = [r for r in rows if (r["condition"], r["disturbance"], r["way"]) == (condition, name, way)]
            if not of:
                continue
            skates = [row[_SKATE] for row in of if np.isfinite(row[_SKATE])]
            means.append(
                {"condition": condition, "disturbance": name, "way": way, "takes": len(of)}
                | {unit: round(geometric_mean([row[unit] for row in of]), 4) for unit in (*_RATIOS, "of_clean")}
                | {"worst_of_clean": max(row["of_clean"] for row in of)}
                | {_SKATE: round(float(np.mean(skates)), 4) if skates else float("nan")}
                | {"most_skate_beyond_cm_s": max(skates, default=float("nan"))}
                | {_DEEPEST: max(row[_DEEPEST] for row in of)}
            )
    return means

"""Test takes and metrics of published work on sparse inputs, solved with the benchmarks' nine markers.

The takes are those of AvatarPoser's (Jiang et al., ECCV 2022) and AGRoL's (Du et al., CVPR 2023) test split that are
available here. Both methods use the position and orientation of three devices, learn from AMASS, and measure 22 joints
of SMPL; here nine points without orientation are used, and this skeleton's joints that correspond to SMPL's.
"""

from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import open_database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings

from .momentum import beside_momentum
from .plots import Picture, check_plots, write_pictures
from .run import Rows, Run
from .scenarios import CMU, LIVE, OFFLINE, PUBLISHED_TAKES
from .solving import describe, solve_both_ways, true_subject
from .tables import groups, mean

# this skeleton's counterparts of SMPL's first 22 joints, with the index of the parent joint
_SMPL = (
    ("root", -1), ("lfemur", 0), ("rfemur", 0), ("lowerback", 0), ("ltibia", 1), ("rtibia", 2), ("upperback", 3),
    ("lfoot", 4), ("rfoot", 5), ("thorax", 6), ("ltoes", 7), ("rtoes", 8), ("lowerneck", 9), ("lclavicle", 9),
    ("rclavicle", 9), ("head", 12), ("lhumerus", 13), ("rhumerus", 14), ("lradius", 16), ("rradius", 17),
    ("lwrist", 18), ("rwrist", 19),
)  # fmt: skip
_OURS = ("deg_per_joint", "mpjpe_mm", "bone_direction_deg", "jitter_ratio", "foot_skate_cm_s", "foot_skate_truth_cm_s")
_MOMENTS = (0.2, 0.5, 0.8)  # positions in a take that are pictured, as shares


def published(run: Run, momentum: Path | None = None, suits: Path | None = None) -> dict[str, Any]:
    """Solve the takes live and offline; measure them as in their publications, and as in the other benchmarks.

    Args:
        momentum: Python interpreter with `pymomentum-cpu`, to solve full suits with Momentum and with our solver.
        suits: Folder that contains c3d/ and trc/; by default that of the motion.

    Returns:
        rows (take, mode, frames, their metrics, ours), means (over the frames of all takes, as they average), suits
        (see `beside_momentum`), priors, database, outputs. Their metrics are mpjre_deg, mpjpe_world_mm, mpjve_cm_s and
        jitter_100_m_s3, with the truth's own jitter; see `published_measures`.
    """
    check_plots()
    database = run.without_takes(run.whole(CMU), "cmu-without-published", PUBLISHED_TAKES)
    path = run.path_of("cmu-without-published")
    settings = {take.title: run.settings_for(subject_of(take.trial)) for take in PUBLISHED_TAKES}
    jobs = {take.title: (take.title, run.read(take), path, settings[take.title]) for take in PUBLISHED_TAKES}
    solved = run.each("published", _solve, jobs, lambda done: done[0])
    rows = [row for each, _ in solved for row in each]
    beside = beside_momentum(run, momentum, suits or run.data) if momentum else []
    figures = {
        "rows": rows,
        "means": _means(rows),
        "suits": beside,
        "priors": {title: Path(each.best.prior_file).name for title, each in settings.items()},
        "database": describe(database),
    }
    plots = write_pictures(run.out / "published-strips", [picture for _, each in solved for picture in each])
    return run.write("published", figures, {"": rows, "suits": beside}, plots)


def _solve(
    title: str, truth: Motion, path: Path, settings: SolveSettings
) -> tuple[list[dict[str, Any]], list[Picture]]:
    """Return the rows for a take and its pictures, in another process."""
    subject = true_subject(truth)
    take, _ = simulate_markers(truth, subject)
    ways = solve_both_ways(take, subject, open_database(path), settings)
    rows = []
    for way in (LIVE, OFFLINE):
        ours = evaluate(ways[way].motion, truth)
        rows.append(
            {"take": title, "way": way, "frames": truth.frames}
            | {name: round(value, 3) for name, value in published_measures(ways[way].motion, truth).items()}
            | {name: round(ours[name], 3) for name in _OURS}
        )
    frames = [int(share * truth.frames) for share in _MOMENTS]
    return rows, [Picture.of(f"{title}, frame {each}", truth, ways[LIVE].motion, each) for each in frames]


def published_measures(motion: Motion, truth: Motion) -> dict[str, float]:
    """Measure a motion like AvatarPoser and AGRoL.

    Args:
        motion: Solved motion with the truth's skeleton, rate and frames.

    Returns:
        mpjre_deg: Mean absolute difference of the components of the rotation vectors of 21 joints, each relative to
        the parent joint, without the root.
        mpjpe_world_mm: Mean distance of 22 joints in the world, without alignment. mpjve_cm_s: Mean difference of their
        velocities. jitter_100_m_s3, jitter_truth_100_m_s3: Mean length of the third derivative, 100 m/s^3.
    """
    (mine_m, mine), (true_m, true) = (_smpl_joints(each) for each in (motion, truth))
    third = [np.linalg.norm(np.diff(each, 3, axis=0), axis=-1).mean() * truth.fps**3 / 100 for each in (mine_m, true_m)]
    velocity = np.diff(mine_m - true_m, axis=0) * truth.fps
    between = np.abs(rot.to_rotation_vector(mine) - rot.to_rotation_vector(true))
    between = np.minimum(between, 2.0 * np.pi - between)  # vectors of nearly half a turn can be opposite
    return {
        "mpjre_deg": float(np.degrees(between.mean())),
        "mpjpe_world_mm": 1e3 * float(np.linalg.norm(mine_m - true_m, axis=-1).mean()),
        "mpjve_cm_s": 100.0 * float(np.linalg.norm(velocity, axis=-1).mean()),
        "jitter_100_m_s3": float(third[0]),
        "jitter_truth_100_m_s3": float(third[1]),
    }


def _smpl_joints(motion: Motion) -> tuple[Array, Array]:
    """Return positions (F, 22, 3) and local rotations (F, 21, 4) of SMPL's joints."""
    positions, turns = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    joints = [motion.skeleton.index(name) for name, _ in _SMPL]
    above = [joints[parent] for _, parent in _SMPL[1:]]
    return positions[:, joints], rot.multiply(rot.conjugate(turns[:, above]), turns[:, joints[1:]])


def _means(rows: Rows) -> list[dict[str, Any]]:
    """Return the means over the frames of all takes, by mode."""
    found = []
    for (way,), of in groups(rows, "way").items():
        weights = [row["frames"] for row in of]
        names = [name for name in of[0] if name not in ("take", "way", "frames")]
        means = {
            name: round(float(np.average([row[name] for row in of], weights=weights)), 3)
            if all(np.isfinite(row[name]) for row in of)
            else mean(of, name)
            for name in names
        }
        found.append({"way": way, "takes": len(of), "frames": sum(weights)} | means)
    return found

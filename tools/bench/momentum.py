"""Full suits solved with Momentum (Meta, MIT) and with our solver: markers, joints, time."""

import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.api import fit_subject, load_take, open_database, solve
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import forward_kinematics, marker_positions
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import SettingsError
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.label_matching import AUTO, choose_marker_set
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.simulated_markers import simulate_markers

from .run import Run
from .scenarios import CMU, PUBLISHED_TAKES, SUITS

_TOOL = Path(__file__).with_name("momentum_solve.py")
_SIMULATED = {"simulated " + take.title: take for take in PUBLISHED_TAKES if take.trial in ("16_34", "127_26")}
_SET = "plug-in-gait"
_HEIGHT_M = 1.75  # height of the body with which both begin


class _Solved(NamedTuple):
    """Joints (F, J, 3) and markers (F, M, 3), metres, and the duration of the body fit and of the solve, s."""

    joints_m: Array
    markers_m: Array
    fit_s: float
    solve_s: float


def beside_momentum(run: Run, python: Path, suits: Path) -> list[dict[str, Any]]:
    """Solve suits with both solvers, each using all markers and a body that it fits itself.

    Args:
        python: Python interpreter with `pymomentum-cpu`.
        suits: Folder that contains c3d/ and trc/.

    Returns:
        rows per take and method: median and 95 % distance of the markers, mean distance of the joints (from the truth
        of a simulated suit; for a recorded one, from our solution), milliseconds per frame, seconds for the body fit.
    """
    run.without_takes(run.whole(CMU), "cmu-without-published", PUBLISHED_TAKES)
    path, python = run.path_of("cmu-without-published"), python.absolute()
    sources: dict[str, Path | Motion] = {name: suits / file for name, file in SUITS.items() if (suits / file).is_file()}
    sources |= {name: run.read(take) for name, take in _SIMULATED.items()}
    jobs = {name: (name, source, path, python) for name, source in sources.items()}
    return [row for rows in run.each("momentum", _both, jobs) for row in rows]


def _both(name: str, source: Path | Motion, database: Path, python: Path) -> list[dict[str, Any]]:
    """Return the rows for a recorded or simulated suit, in another process."""
    start, take = _start(source)
    ours, theirs = _ours(take, start, database), _theirs(take, start, python)
    true_m = ours.joints_m
    if isinstance(source, Motion):
        true_m, _ = forward_kinematics(source.skeleton, source.rotations, source.root_positions_m)
    seen_m = take.positions_m[:, [take.names.index(each) for each in start.marker_set.names]]
    rows = []
    for method, solved in (("perfanim", ours), ("momentum", theirs)):
        distance_mm = 1e3 * np.linalg.norm(solved.markers_m - seen_m, axis=-1)
        joints_mm = 1e3 * np.linalg.norm(solved.joints_m - true_m, axis=-1)
        rows.append(
            {"take": name, "method": method, "frames": len(seen_m), "markers": seen_m.shape[1]}
            | {"marker_mm": round(float(np.nanmedian(distance_mm)), 2)}
            | {"marker_95_mm": round(float(np.nanpercentile(distance_mm, 95)), 2)}
            | {
                "joints_mm": round(float(joints_mm.mean()), 2),
                "joints_95_mm": round(float(np.percentile(joints_mm, 95)), 2),
            }
            | {"ms_per_frame": round(1e3 * solved.solve_s / len(seen_m), 2), "fit_s": round(solved.fit_s, 2)}
        )
    return rows


def _start(source: Path | Motion) -> tuple[Subject, MarkerTake]:
    """Return the default body with the take's marker set, without markers that are never visible, and the take."""
    if isinstance(source, Motion):
        worn = load_marker_set(_SET)
        take, _ = simulate_markers(source, Subject(source.name, source.skeleton, worn))
    else:
        take = load_take(source)
        worn = choose_marker_set(AUTO, take.names, str(source))
    there = [name for name in worn.names if name in take.names and take.visible[:, take.names.index(name)].any()]
    return Subject("performer", default_skeleton(_HEIGHT_M), worn.subset(there)), take


def _ours(take: MarkerTake, start: Subject, database: Path) -> _Solved:
    opened, before = open_database(database), time.perf_counter()
    subject = fit_subject(take, opened, start.marker_set, _HEIGHT_M)
    between = time.perf_counter()
    motion = solve(take, subject, opened).motion
    joints_m, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    worn = subject.marker_set.joint_indices(motion.skeleton)
    places = (motion.skeleton, worn, subject.marker_set.offsets_m, motion.rotations, motion.root_positions_m)
    return _Solved(joints_m, marker_positions(*places), between - before, time.perf_counter() - between)


def _theirs(take: MarkerTake, start: Subject, python: Path) -> _Solved:
    """Return Momentum's solution, computed by another Python and exchanged through files."""
    worn, skeleton = start.marker_set, start.skeleton
    with TemporaryDirectory() as folder:
        given, out = Path(folder) / "given.npz", Path(folder) / "solved.npz"
        np.savez(
            given,
            joints=np.array(skeleton.names),
            parents=skeleton.parents,
            offsets_m=skeleton.offsets_m,
            markers=np.array(worn.names),
            of_joint=worn.joint_indices(skeleton),
            places_m=worn.offsets_m,
            positions_m=take.positions_m[:, [take.names.index(name) for name in worn.names]],
        )
        done = subprocess.run([python, _TOOL, given, out], capture_output=True, text=True, check=False)
        if done.returncode:
            advice = "give a Python with pymomentum-cpu"
            raise SettingsError(f"Momentum failed ({done.stderr.strip()[-300:]})", where=str(python), advice=advice)
        with np.load(out) as solved:
            return _Solved(*(solved[name] for name in ("joints_m", "markers_m")), *map(float, solved["seconds"]))

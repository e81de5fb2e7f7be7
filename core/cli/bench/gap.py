"""What the distance to the paper's Figure 6 is made of: amount of data, rate, marker set, unit, and the model."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...body.motion import Motion, sliced
from ...body.motion_metrics import evaluate
from ...database.build import BuildSettings, build_database
from ...database.store import Clip, Database, open_database, pose_from_rotations, rotations_from_pose
from ...geometry import rotations as rot
from ...markers.marker_set import load_marker_set
from ...markers.subject import Subject
from ...solver import local_model
from ...solver.search.exhaustive import closest
from ...solver.subject_model import SubjectModel
from .data import (
    BOXING,
    CMU,
    SPLIT,
    WALKING,
    Progress,
    TestTake,
    data_folders,
    read_take,
    whole_database,
    without_tests,
)
from .figure6 import MARKER_SET, solved
from .heterogeneity import is_walk
from .methods import METHODS
from .report import write_json, write_rows

_SECONDS = 5.0  # of each take
_BOXING_SECONDS = (0.0, 4.0, 8.0, 15.0)  # of boxing by the same performer; all of it is 30 s
_WALKING_SHARES = (0.0, 0.125, 0.25, 0.5)
_RATES = (30.0, 120.0)
_MARKER_SETS = ("locomotion", "kendo", "one-camera")
_MODELS = ((30, 3), (60, 7), (120, 7), (120, 25), (400, 7), (400, 50))  # K, B
_METHODS = ("nearest", "local-pca (paper's range)", "local-pca (tuned)", "best")
_UNITS = ("deg_per_joint", "deg_per_angle", "mpjpe_mm", "bone_direction_deg", "twist_deg")


@dataclass(frozen=True)
class _Condition:
    """What is changed, to what, and how a take is then solved."""

    changed: str
    value: str
    database: Database
    truth: Motion
    marker_set: str = MARKER_SET


def gap(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Solve parts of Figure 6's takes under conditions that differ from it in one respect each, and write the table.

    Args:
        data: folder that holds `cmu`.
        out: folder to write to.
        workers: processes that read motion.

    Returns:
        rows (take, what was changed and to what, method, errors in all units, share of nearest's), models (what the
        local model could express at best, by K, B and how its neighbours were found), outputs.
    """
    whole = whole_database(data, out, (CMU,), workers, progress)
    database = without_tests(whole, out / "databases" / "cmu-without-tests.perfdb")
    at_rates = {fps: _at_rate(data, out, fps, workers) for fps in _RATES}
    rows, models = [], []
    for number, take in enumerate((BOXING, WALKING)):
        truth = _shortened(read_take(data, take))
        conditions = [
            _Condition("nothing", "", database, truth),
            *_less_data(whole, out, take, truth),
            *(_Condition("rate", f"{fps:g} Hz", at_rates[fps], _at(data, take, fps)) for fps in _RATES),
            *(_Condition("marker set", name, database, truth, name) for name in _MARKER_SETS),
        ]
        for done, condition in enumerate(conditions):
            progress(0.3 + 0.35 * (number + done / len(conditions)), f"{take.title}: {condition.changed}")
            rows += [{"take": take.title} | row for row in _solved_by_all(condition)]
        models += [{"take": take.title} | row for row in expressible(truth, database)]
    write_json(out / "gap.json", {"rows": rows, "models": models})
    write_rows(out / "gap.csv", rows)
    write_rows(out / "gap-models.csv", models)
    names = ("gap.json", "gap.csv", "gap-models.csv")
    return {"rows": rows, "models": models, "outputs": [str(out / name) for name in names]}


def _shortened(truth: Motion) -> Motion:
    return sliced(truth, 0, min(truth.frames, int(_SECONDS * truth.fps)))


def _at(data: Path, take: TestTake, fps: float) -> Motion:
    return _shortened(read_take(data, take, fps))


def _at_rate(data: Path, out: Path, fps: float, workers: int) -> Database:
    """Return the database without the test takes at another rate."""
    folder = out / "databases"
    path = folder / f"cmu-{fps:g}.perfdb"
    if not path.exists():
        build_database(
            data_folders(data, (CMU,)),
            path,
            BuildSettings(fps=fps, workers=workers),
            progress=lambda fraction, text: None,
        )
    return without_tests(open_database(path), folder / f"cmu-without-tests-{fps:g}.perfdb")


def _less_data(whole: Database, out: Path, take: TestTake, truth: Motion) -> Iterator[_Condition]:
    """Yield the databases with less of the take's behaviour."""
    if take is BOXING:
        for seconds in _BOXING_SECONDS:
            path = out / "databases" / f"cmu-boxing-{seconds:g}s.perfdb"
            yield _Condition("boxing in the database", f"{seconds:g} s", _with_seconds(whole, path, seconds), truth)
        return
    for share in _WALKING_SHARES:
        path = out / "databases" / f"cmu-walking-{share:g}.perfdb"
        database = without_tests(whole, path, _some_walks(whole, share))
        seconds = sum(clip.stop - clip.start for clip in database.clips if is_walk(clip)) / database.fps
        yield _Condition("walking in the database", f"{seconds:.0f} s", database, truth)


def _with_seconds(whole: Database, path: Path, seconds: float) -> Database:
    split = next(clip for clip in whole.clips if clip.name == SPLIT)
    share = seconds * whole.fps / (split.stop - split.start)
    return without_tests(whole, path, split_at=share)


def _some_walks(whole: Database, share: float) -> Callable[[Clip], bool]:
    walks = [clip.name for clip in whole.clips if is_walk(clip)]
    count = round(share * len(walks))
    kept = {walks[round(i)] for i in np.linspace(0, len(walks) - 1, count)} if count else set()
    return lambda clip: not is_walk(clip) or clip.name in kept


def _solved_by_all(condition: _Condition) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for method in _METHODS:
        motion, _ = solved(condition.truth, condition.database, METHODS[method], condition.marker_set)
        errors = evaluate(motion, condition.truth)
        row: dict[str, Any] = {"changed": condition.changed, "value": condition.value, "method": method}
        row |= {unit: round(errors[unit], 4) for unit in _UNITS}
        reference = rows[0] if rows else row
        rows.append(row | {f"{unit} / nearest": round(row[unit] / reference[unit], 3) for unit in _UNITS[:2]})
    return rows


def expressible(truth: Motion, database: Database) -> list[dict[str, Any]]:
    """Return how close the best pose of the local model comes to the truth, degrees per joint.

    What remains is beyond any way to find its weights: the neighbours do not span the pose. The rest of a method's
    error is that few markers do not tell the weights.

    Returns:
        rows (neighbours found by markers or by the true pose, K, B, deg_per_joint).
    """
    subject = Subject(truth.name, truth.skeleton, load_marker_set(MARKER_SET))
    model = SubjectModel(subject, database.mean_rotations)
    poses = np.asarray(database.poses).reshape(database.frames, -1)
    shown = model.database_markers(database).reshape(database.frames, -1)
    true = pose_from_rotations(truth.rotations, database.mean_rotations).reshape(truth.frames, -1)
    seen = model.markers(true.reshape(truth.frames, -1, 3)).reshape(truth.frames, -1)
    rows = []
    for found_by, base, queries in (("markers", shown, seen), ("true pose", poses, true)):
        neighbours = _neighbours(base, queries.astype(np.float32), max(k for k, _ in _MODELS))
        for k, b in _MODELS:
            best = np.empty_like(true)
            for frame, near in enumerate(neighbours):
                local = local_model.fit(poses[near[:k]].astype(np.float64), b)
                best[frame] = local.pose(local.weights(true[frame]))
            rotations = rotations_from_pose(
                best.reshape(truth.frames, -1, 3), database.mean_rotations, truth.rotations[:, 0]
            )
            error = np.degrees(rot.angle_between(rotations[:, 1:], truth.rotations[:, 1:])).mean()
            rows.append({"neighbours by": found_by, "K": k, "B": b, "deg_per_joint": round(float(error), 4)})
    return rows


def _neighbours(base: NDArray[np.float32], queries: NDArray[np.float32], count: int) -> list[NDArray[np.int64]]:
    norms = np.einsum("fd,fd->f", base, base)
    return [closest(norms - 2.0 * (base @ query), count)[0] for query in queries]

"""People in suits with many markers, solved with nine: how far off the others are, whether errors are as expected."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from perfanim.core import PACKAGE_ROOT
from perfanim.core.api import SolveRequest, load_subject, load_take, open_database, solve
from perfanim.core.body.standard_skeleton import JOINT_NAMES
from perfanim.core.errors import FormatError
from perfanim.core.session.steady_motion import motion_of

from .baseline import Baseline
from .keypoints import keypoints
from .run import Rows, Run
from .scenarios import BASELINES, CMU, LIVE, OFFLINE, SUITS
from .solving import Expected, coverage, expected_of
from .tables import geometric_mean, interval

_USED = 9  # number of markers to solve with


class _Version(NamedTuple):
    """A version of the product with a database that it can read."""

    product: Baseline
    database: Path


def suits(run: Run, baseline: Path | None = None, suits: Path | None = None) -> dict[str, Any]:
    """Solve suits with nine of their markers; measure the distance of the others, and the errors of the pose.

    Errors of the pose are angles to the one solved offline from all markers; they are compared with the expected ones.

    Body and offsets are fitted once per take, and the nine markers are chosen once, by this version. Databases contain
    all of CMU; the learned prior is the shipped one, which has seen none of the performers as far as their files say.

    Args:
        baseline: Folder of another version, which solves with the same body and markers.
        suits: Folder that contains c3d/ and trc/; by default `data`.

    Returns:
        rows (take, method, used markers, left_out_rms_mm), ratios (to the other version: geometric mean with its 95 %
        interval, worst take), intervals (shares of errors within twice the expected error, by take and for all),
        missing (takes that the folder lacks), keypoints (see `keypoints`), outputs.

    Raises:
        FormatError: The folder contains none of the takes.
    """
    folder = suits or run.data
    there = {name: folder / path for name, path in SUITS.items() if (folder / path).is_file()}
    if not there:
        advice = "give the folder of c3d/ and trc/ with --suits"
        raise FormatError("holds none of the suits' takes", where=str(folder), advice=advice)
    whole = run.whole(CMU)
    ours, theirs = _Version(Baseline(PACKAGE_ROOT, run, "suits"), whole.path.resolve()), None
    if baseline:
        product = Baseline(baseline, run)
        database = product.database(whole.path.stem, {clip.name for clip in whole.clips})
        theirs = _Version(product, database.resolve())
    jobs = {name: (name, path.resolve(), ours, theirs, run.out.resolve() / "suits") for name, path in there.items()}
    solved = run.each("suits", _solve, jobs, lambda done: done.rows)
    rows = [row for each in solved for row in each.rows]
    figures: dict[str, Any] = {"rows": rows, "ratios": [_ratio(rows, way) for way in (LIVE, OFFLINE)] if theirs else []}
    by_take = {name: [each] for name, each in zip(jobs, solved, strict=True)} | {"all": solved}
    figures["intervals"] = [
        {"take": name, "way": way} | coverage([each.expected[way] for each in of], JOINT_NAMES[1:])
        for name, of in by_take.items()
        for way in (LIVE, OFFLINE)
    ]
    figures["missing"] = [name for name in SUITS if name not in there]
    figures["keypoints"], strips = keypoints(run)
    return run.write("suits", figures, {"": rows, "keypoints": figures["keypoints"]}, strips)


class _Solved(NamedTuple):
    """A take solved by all methods."""

    rows: list[dict[str, Any]]
    expected: dict[str, Expected]  # expected errors, and those relative to the pose of all markers, by mode


def _solve(name: str, path: Path, ours: _Version, theirs: _Version | None, folder: Path) -> _Solved:
    """Solve a take with each method, in another process."""
    file, motion = folder / f"{name}.toml", folder / f"{name}.bvh"
    fit = ("--database", str(ours.database), "--marker-set", "auto")
    ours.product.call("calibrate", "subject", str(path), *fit, "--out", str(file))
    subject, database = load_subject(file), open_database(ours.database)
    take = load_take(path, subject.marker_set)
    whole = motion_of(solve(take, subject, database).poses_of(), subject, take.name, take.fps)
    offline = solve(take, subject, database, SolveRequest(marker_count=_USED))
    used = tuple(offline.report["used"])
    several = {OFFLINE: offline, LIVE: solve(take, subject, database, SolveRequest(markers=used, causal=True))}
    facts = {way: solved.summary() | solved.report for way, solved in several.items()}
    if theirs:
        body = ("--subject", str(file), "--database", str(theirs.database), "--use", ",".join(used), "--up", "auto")
        facts[BASELINES[OFFLINE]] = json.loads(
            theirs.product.call("solve", str(path), *body, "--out", str(motion), "--json")
        )
    rows = [
        {"take": name, "method": method, "frames": found["frames"], "used": " ".join(used)}
        | {key: round(found[key], 3) for key in ("left_out_rms_mm", "marker_rms_mm")}
        for method, found in facts.items()
    ]
    return _Solved(rows, {way: expected_of(solved.poses_of(), whole) for way, solved in several.items()})


def _ratio(rows: Rows, way: str) -> dict[str, Any]:
    """Return the distances relative to the other version's."""
    by = {(row["take"], row["method"]): row["left_out_rms_mm"] for row in rows}
    ratios = np.array([by[take, way] / by[take, BASELINES[OFFLINE]] for take, method in by if method == way])
    low, high = interval(np.log(ratios))
    row = {
        "method": way,
        "other": BASELINES[OFFLINE],
        "takes": len(ratios),
        "left_out": round(geometric_mean(ratios), 3),
    }
    return row | {"low": low, "high": high, "worst": round(float(ratios.max()), 3)}

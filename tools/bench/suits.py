"""People in suits of many markers, solved with nine: how far off the others are."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core import PACKAGE_ROOT
from perfanim.core.errors import FormatError
from perfanim.core.system.progress import Progress

from .baseline import Baseline
from .data import CMU, whole_database
from .methods import BASELINE
from .paired import geometric_mean, interval
from .processes import Processes
from .report import Rows, write_figures
from .solved_takes import LIVE, OFFLINE

# public recordings of moving people with at least 24 named markers of a shipped set, the only ones there
TAKES = {
    "running": "c3d/jstoecker_c3dviewer/examples/running.c3d",
    "kick": "c3d/jstoecker_c3dviewer/examples/kick.c3d",
    "calibration": "c3d/BTKData/PiG/PiG_Calibration-FlatFoot-Full.c3d",
    "gait": "trc/BTKData/TRCSamples/Gait.trc",
    "ballet": "trc/BTKData/TRCSamples/MOTEK/ballet_reduced.trc",
}
_USED = "9"  # markers to solve with


@dataclass(frozen=True)
class _Version:
    """A version of the product with a database that it can read."""

    product: Baseline
    database: Path


def suits(
    data: Path,
    out: Path,
    workers: int,
    progress: Progress,
    checkout: Path | None = None,
    suits_data: Path | None = None,
) -> dict[str, Any]:
    """Solve suits with nine of their markers; measure the distance of the others.

    Body and offsets are fitted to each take once, and the nine markers are chosen once, by this version. Databases hold
    all of CMU; the learned prior is the shipped one, which has seen nobody of the takes as far as their files say.

    Args:
        checkout: of another version; it solves with the same body and markers.
        suits_data: folder that holds c3d/ and trc/; default `data`.

    Returns:
        rows (take, method, used markers, left_out_rms_mm), ratios (to the other version: geometric mean with its 95 %
        interval, worst take), missing (takes that the folder lacks), outputs.

    Raises:
        FormatError: the folder holds none of the takes.
    """
    out.mkdir(parents=True, exist_ok=True)
    folder = suits_data or data
    there = {name: folder / path for name, path in TAKES.items() if (folder / path).is_file()}
    if not there:
        raise FormatError(
            "holds none of the suits' takes", where=str(folder), advice="give the folder of c3d/ and trc/ with --suits"
        )
    whole = whole_database(data, out, (CMU,), workers, progress)
    ours = _Version(Baseline(PACKAGE_ROOT, data, out / "suits"), whole.path)
    theirs = None
    if checkout:
        product = Baseline(checkout, data, out / "baseline")
        theirs = _Version(product, product.database(whole.path.stem, {clip.name for clip in whole.clips}))
    with Processes(workers, out) as processes:
        jobs = {name: (name, path.resolve(), ours, theirs, out.resolve() / "suits") for name, path in there.items()}
        solved = processes.run("suits", _solve, jobs, lambda rows: rows, progress)
    rows = [row for each in solved for row in each]
    figures: dict[str, Any] = {"rows": rows, "ratios": [_ratio(rows, way) for way in (LIVE, OFFLINE)] if theirs else []}
    figures["missing"] = [name for name in TAKES if name not in there]
    return write_figures(out, "suits", figures, {"": rows})


def _solve(name: str, path: Path, ours: _Version, theirs: _Version | None, folder: Path) -> list[dict[str, Any]]:
    """Return a row of each method for a take, in the other process."""
    subject, motion = folder / f"{name}.toml", folder / f"{name}.bvh"
    fit = ("--database", str(ours.database.resolve()), "--marker-set", "auto")
    ours.product.run("calibrate", "subject", str(path), *fit, "--out", str(subject))

    def solved_by(version: _Version, use: str, *options: str) -> dict[str, Any]:
        body = ("--subject", str(subject), "--database", str(version.database.resolve()), "--use", use, "--up", "auto")
        text = version.product.run("solve", str(path), *body, *options, "--out", str(motion), "--json")
        facts: dict[str, Any] = json.loads(text)
        return facts

    facts = {OFFLINE: solved_by(ours, _USED)}
    use = ",".join(facts[OFFLINE]["used"])
    facts[LIVE] = solved_by(ours, use, "--causal")
    if theirs:
        facts[BASELINE] = solved_by(theirs, use)
    return [
        {"take": name, "method": method, "frames": found["frames"], "used": use.replace(",", " ")}
        | {"left_out_rms_mm": round(found["left_out_rms_mm"], 3), "marker_rms_mm": round(found["marker_rms_mm"], 3)}
        for method, found in facts.items()
    ]


def _ratio(rows: Rows, way: str) -> dict[str, Any]:
    """Return the distances of a way as shares of the other version's."""
    by = {(row["take"], row["method"]): row["left_out_rms_mm"] for row in rows}
    logs = np.log([by[take, way] / by[take, BASELINE] for take, method in by if method == way])
    low, high = interval(logs)
    worst = round(float(np.exp(logs.max())), 3)
    mean = round(geometric_mean(np.exp(logs).tolist()), 3)
    return {
        "method": way,
        "other": BASELINE,
        "takes": len(logs),
        "left_out": mean,
        "low": low,
        "high": high,
        "worst": worst,
    }

"""Label faults inserted into takes at random: how many are found, and how much accuracy they cost."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.api.solving import solve_markers
from perfanim.core.body.body_parts import PARTS
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.store import open_database
from perfanim.core.formats.motion.motion_sources import MotionFile, motion_files
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry.arrays import Array, Mask, runs
from perfanim.core.markers.jump_gate import Carried
from perfanim.core.markers.label_faults import FaultKind, LabelFault, correct_labels
from perfanim.core.markers.marker_set import PointKind, load_marker_set
from perfanim.core.markers.marker_smoothing import MarkerSmoother
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.simulated_markers import simulate_markers

from .run import Rows, Run
from .scenarios import BANDAI, CMU, FPS, LABEL_FAULTS, LABELLED_TAKES, LABELS_CHOSEN_ON
from .tables import groups

_LEAST_M = 0.02  # smallest error of a marker that counts as a fault; frozen markers of a planted foot do not
_WILD_M = (0.05, 0.17)  # distance of wild points
_WILD_FRAMES = 3  # most wild points in a row
_LASTS_S = (0.1, 1.0)  # duration of exchanges and frozen stretches
_APART_S = 0.5  # time between two faults
_TRIES = 100
_NOISE_MM = 1.0
_SOLVED_S = 6.0  # duration of each take that is solved
_EVERY = 24  # step between the clips of the other studio that are used, because there are many
_ENDS = (("arm", "hand"), ("leg", "foot"))
_LIMBS = {f"{side} {limb}": (f"{side} {limb}", f"{side} {end}") for side in ("left", "right") for limb, end in _ENDS}
_LIVE = "exchanged live"  # kind of a false alarm of the live gate
_CLOSE = 1.2  # largest ratio of a limb's error to that without faults that counts as close


@dataclass(frozen=True)
class Fault:
    """A fault that was inserted into a take.

    Args:
        name: Kind of fault, for tables.
        stretch: Where it is.
        wrong: Mask (F, M) of positions that it moved by at least 20 mm.
    """

    name: str
    stretch: LabelFault
    wrong: Mask


def with_faults(take: MarkerTake, names: Sequence[str], seed: int) -> tuple[MarkerTake, list[Fault]]:
    """Return a take with one fault of each name, as far as there is space.

    Args:
        names: "frozen", "wild", "sides" (all markers of both sides), or the ends of two names, such as "FOO" for LFOO
            and RFOO.
    """
    generator = np.random.default_rng(seed)
    positions, free = take.positions_m.copy(), np.ones(take.frames, dtype=bool)
    faults = []
    apart = round(_APART_S * take.fps)
    free[: apart // 2] = free[-(apart // 2) :] = False
    for name in names:
        for _ in range(_TRIES):
            made = _made(take, name, generator)
            if made is None:
                continue
            stretch, changed = made
            if not free[max(0, stretch.first - apart) : stretch.last + apart + 1].all():
                continue
            away = np.linalg.norm(changed - take.positions_m[stretch.first : stretch.last + 1], axis=-1)
            wrong = np.zeros(take.positions_m.shape[:2], dtype=bool)
            wrong[stretch.first : stretch.last + 1] = away > _LEAST_M
            if not wrong.any():
                continue
            positions[stretch.first : stretch.last + 1] = changed
            free[stretch.first : stretch.last + 1] = False
            faults.append(Fault(name, stretch, wrong))
            break
    return replace(take, positions_m=positions), faults


def _made(take: MarkerTake, name: str, generator: np.random.Generator) -> tuple[LabelFault, Array] | None:
    """Return a fault at a random position, and the positions (n, M, 3) of its frames."""
    frames = int(generator.integers(1, _WILD_FRAMES + 1))
    if name != "wild":
        frames = max(round(float(generator.uniform(*_LASTS_S)) * take.fps), 2)
    if frames + 2 > take.frames:
        return None
    first = int(generator.integers(1, take.frames - frames))
    rows = slice(first, first + frames)
    changed = take.positions_m[rows].copy()
    if name in ("frozen", "wild"):
        marker = int(generator.integers(len(take.names)))
        kind = FaultKind.FROZEN if name == "frozen" else FaultKind.WILD
        if name == "frozen":
            changed[:, marker] = take.positions_m[first - 1, marker]
        else:
            away = generator.normal(size=3)
            changed[:, marker] += away / np.linalg.norm(away) * generator.uniform(*_WILD_M)
        labels: tuple[str, ...] = (take.names[marker],)
    else:
        end, kind = "" if name == "sides" else name, FaultKind.EXCHANGED
        left = [each for each in take.names if each[0] == "L" and each.endswith(end) and "R" + each[1:] in take.names]
        for each in left:
            pair = [take.names.index(each), take.names.index("R" + each[1:])]
            changed[:, pair] = changed[:, pair[::-1]]
        labels = tuple(side + each[1:] for each in left for side in "LR")
        if not labels:
            return None
    return LabelFault(first, first + frames - 1, labels, kind), changed


def scored(
    take: MarkerTake,
    corrected: MarkerTake,
    live_m: Array,
    found: Sequence[LabelFault],
    faults: Sequence[Fault],
) -> tuple[list[dict[str, Any]], list[LabelFault]]:
    """Return a row for each fault, and the reported stretches that do not match one.

    Args:
        take: Take without faults.
        corrected: Take with faults, corrected.
        live_m: Markers (F, M, 3) with faults that the live gate let through, NaN where it doubted them.
    """
    told = np.zeros(take.positions_m.shape[:2], dtype=bool)
    for each in found:
        told[each.first : each.last + 1, [take.names.index(label) for label in each.labels]] = True
    away, live_away = (
        np.linalg.norm(points_m - take.positions_m, axis=-1) for points_m in (corrected.positions_m, live_m)
    )
    rows = [
        {
            "fault": fault.name,
            "first": fault.stretch.first,
            "frames": fault.stretch.last - fault.stretch.first + 1,
            "found": bool(told[fault.wrong].mean() >= 0.5),
            "left_wrong": round(float((away[fault.wrong] > _LEAST_M).mean()), 3),
            "live_wrong": round(float((live_away[fault.wrong] > _LEAST_M).mean()), 3),
        }
        for fault in faults
    ]
    alarms = [
        each
        for each in found
        if not any(
            each.first <= fault.stretch.last + 1
            and each.last >= fault.stretch.first - 1
            and set(each.labels) & set(fault.stretch.labels)
            for fault in faults
        )
    ]
    return rows, alarms


def label_faults(run: Run, seed: int = 0) -> dict[str, Any]:
    """Insert faults into takes that were not used to choose the settings; find them, and solve with and without them.

    Returns:
        found (by marker set and fault), found_share, limbs (mean error of the joints of each limb of each take, as a
        ratio to that without faults), limbs_median, limbs_worst, limbs_close (share of ratios up to 1.2), clean_s,
        alarms (in clean takes), alarms_per_10_min (recorded), live_alarms (exchanges that the live gate saw in clean
        takes), outputs.
    """
    folders = run.folders((CMU, BANDAI))
    with motion_files(folders) as files:
        chosen = [file for file in files if file.stem.split("_")[0] not in LABELS_CHOSEN_ON]
        chosen = [file for at, file in enumerate(chosen) if "dataset" not in file.stem or at % _EVERY == 0]
        jobs: dict[str, tuple[Any, ...]] = {file.stem: (file, seed + at) for at, file in enumerate(chosen)}
        looked = run.each("label-faults-found", _look, jobs, lambda each: each[0])
    database = run.embedded().path
    worn = list(LABEL_FAULTS)
    takes = {
        take.title: (run.read(take), worn[at % len(worn)], database, seed + at)
        for at, take in enumerate(LABELLED_TAKES)
    }
    limbs = [row for rows in run.each("label-faults-limbs", _limbs, takes, lambda rows: rows) for row in rows]
    rows = [row for each in looked for row in each[0]]
    alarms = [row for each in looked for row in each[1]]
    seconds, ratios = sum(each[2] for each in looked), np.array([row["ratio"] for row in limbs])
    found = [
        {
            "markers": markers,
            "fault": fault,
            "put_in": len(of),
            "found": round(float(np.mean([r["found"] for r in of])), 4),
        }
        | {name: round(float(np.mean([r[name] for r in of])), 4) for name in ("left_wrong", "live_wrong")}
        for (markers, fault), of in groups(rows, "markers", "fault").items()
    ]
    figures: dict[str, Any] = {
        "found": found,
        "found_share": round(float(np.mean([row["found"] for row in rows])), 4),
        "limbs": limbs,
        "limbs_median": round(float(np.median(ratios)), 4),
        "limbs_worst": float(ratios.max()),
        "limbs_close": round(float(np.mean(ratios <= _CLOSE)), 4),
        "clean_s": round(seconds, 1),
        "alarms": alarms,
        "alarms_per_10_min": round(600.0 * sum(row["kind"] != _LIVE for row in alarms) / seconds, 3),
        "live_alarms": sum(row["kind"] == _LIVE for row in alarms),
    }
    return run.write("label-faults", figures, {"": rows, "limbs": limbs, "alarms": alarms})


def _look(file: MotionFile, seed: int) -> tuple[Rows, Rows, float]:
    """Return a row for each fault put into a take, one for each false alarm in the clean take, and its duration, s."""
    motion = read_motion(file.path, file.skeleton)
    motion = resampled(motion, FPS) if motion.fps > FPS else motion
    rows, alarms, seconds = [], [], 0.0
    for name, faults in LABEL_FAULTS.items():
        subject = Subject(name, default_skeleton(), load_marker_set(name))
        clean, _ = simulate_markers(motion, subject.marker_set, _NOISE_MM, seed=seed)
        seconds += clean.frames / clean.fps
        of = {"take": file.stem, "markers": name}
        alarms += [of | _row(fault) for fault in correct_labels(clean, subject)[1]]
        exchanged = _gated(clean)[1].any(axis=1)
        alarms += [
            of | {"first": start, "last": stop - 1, "kind": _LIVE, "labels": ""} for start, stop in runs(exchanged)
        ]
        faulty, put_in = with_faults(clean, faults, seed)
        corrected, found = correct_labels(faulty, subject)
        rows += [of | row for row in scored(clean, corrected, _gated(faulty)[0], found, put_in)[0]]
    return rows, alarms, seconds


def _gated(take: MarkerTake) -> tuple[Array, Mask]:
    """Return the markers (F, M, 3) that the gate of live captures lets through, and those whose labels it changed."""
    smoother = MarkerSmoother(len(take.names), noise_of(PointKind.MARKERS))
    unknown = Carried(np.full((len(take.names), 3), np.nan))  # nothing is solved here
    found = [
        smoother.step(time_s, points_m, unknown).believed
        for time_s, points_m in zip(take.times_s.tolist(), take.positions_m, strict=True)
    ]
    return np.array([each.points_m for each in found]), np.array([each.exchanged for each in found])


def _row(fault: LabelFault) -> dict[str, Any]:
    return {"first": fault.first, "last": fault.last, "kind": fault.kind.value, "labels": " ".join(fault.labels)}


def _limbs(truth: Motion, markers: str, database: Path, seed: int) -> Rows:
    """Return the error of each limb of a take with faults, as a ratio to that without."""
    frames = min(round(_SOLVED_S * truth.fps), truth.frames)
    first = (truth.frames - frames) // 2
    truth = sliced(truth, first, first + frames)
    subject = Subject(truth.name, truth.skeleton, load_marker_set(markers))
    clean, _ = simulate_markers(truth, subject, _NOISE_MM, seed=seed)
    faulty, put_in = with_faults(clean, LABEL_FAULTS[markers], seed)
    opened = open_database(database)
    untouched, corrected = (
        evaluate(solve_markers(take, subject, opened).motion, truth)["per_joint"] for take in (clean, faulty)
    )
    rows = []
    for limb, parts in _LIMBS.items():
        joints = [joint for part in parts for joint in PARTS[part]]
        with_mm, without_mm = (
            float(np.mean([of[joint]["position_mm"] for joint in joints])) for of in (corrected, untouched)
        )
        of = {"take": truth.name, "markers": markers, "frames": frames, "faults": len(put_in), "limb": limb}
        rows.append(of | {"untouched_mm": round(without_mm, 2), "ratio": round(with_mm / without_mm, 4)})
    return rows

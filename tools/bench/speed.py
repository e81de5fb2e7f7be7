"""Computing time of all stages, compared with an exhaustive search in NumPy in the same run.

The search makes figures from different machines comparable. To see where a frame's time goes: `python -m cProfile`.
"""

import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import Database, open_database
from perfanim.core.geometry.arrays import FloatArray, Image, IntArray
from perfanim.core.kernel.library import use_kernel
from perfanim.core.labelling.labeller import Labeller
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.prop import load_prop
from perfanim.core.markers.subject import Subject
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from perfanim.core.session.session_cache import SessionCache
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.discs import draw_disc
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import no_progress
from perfanim.core.vision.detection.background import learn_backgrounds
from perfanim.core.vision.detection.blob_detector import Detector
from perfanim.core.vision.live_frames import live_settings
from perfanim.core.vision.pipeline import MarkerPipeline

from .run import Run
from .scenarios import BANDAI, CMU, FPS, LEFT_OUT, SPLIT, UNLIKE, WALKING
from .solving import true_subject
from .vision import noisy

Row = dict[str, Any]

STAGES = ("detect", "locate", "label")
FIRST_FRAMES = 20  # frames in which a session starts up
_REFERENCE = (433_000, 60, 32)  # rows, columns, nearest
_REFERENCE_RUNS = 15
_DATABASE_FRAMES = 395_399
_PAIRS, _STREAM_FPS = 480, 240.0
_EMPTY = 30  # images of the empty capture space
_SKIPPED_S, _LEAST_S = 4.0, 3.0  # part of the performance skipped (T pose, arms down); shortest duration
_BLOCK = 40  # pairs of images in one measurement of processor time, because the clock's steps are coarse
_MARKERS, _MARKER_PX, _MARKER_LEVEL, _ROOM_LEVEL = 12, 3.0, 220.0, 16.0
_IMAGES = 40
_TURNS = 240  # frames solved by kernel and NumPy in turn
_SCENE: Row = {"behaviour": "kendo", "prop": "sword", "partners": [{"behaviour": "boxing", "height_m": 1.65}]}
_PART_FRAMES = 250  # frames of each recorded take
_WARM_FRAMES = 20  # frames solved by each process before recorded takes are timed


def speed(run: Run) -> dict[str, Any]:
    """Time all stages and write the figures.

    Processor time counts all threads of a process; for figures of a single core run this with OPENBLAS_NUM_THREADS=1.

    Returns:
        rows (work, value, unit, clock, goal or "", ratio to the reference search or ""), machine (processors, load),
        outputs.
    """
    cv2.setNumThreads(1)  # as in the cameras' process
    load_before = _load()
    run.progress(0.0, "detection, and images to labelled points")
    rows = _detection_and_labels(run.embedded())
    run.progress(0.3, "importing motion")
    whole, imported = _import(run)
    rows += imported
    run.progress(0.7, "solving")
    database, takes = _part_of(run, whole), [run.read(take) for take in (WALKING, UNLIKE)]
    rows += _solving(takes[0], database)
    for title, truth in zip(("known", "unlike"), takes, strict=True):
        subject = true_subject(truth)
        frames = list(frames_without_labels(sliced(truth, 0, _TURNS), subject))
        rows += _by_both_bodies(f"frame without labels, {title}", frames, partial(Session, subject, database))
    rows += _scene(database)
    run.progress(0.8, "solving recorded takes")
    rows += _recorded(takes, database.path)
    machine = {"processors": os.cpu_count(), "load_before": load_before, "load_after": _load()}
    return run.write("speed", {"rows": rows, "machine": machine}, {"": rows})


def _load() -> list[float]:
    """Return the machine's load, empty if unknown: figures from a busy machine mean less."""
    return [round(value, 2) for value in os.getloadavg()] if hasattr(os, "getloadavg") else []


def reference_ms() -> tuple[float, float]:
    """Return the median wall and processor time of exhaustive NumPy searches, ms."""
    count, size, wanted = _REFERENCE
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((count, size), dtype=np.float32)
    norms = np.einsum("fd,fd->f", rows, rows)
    queries = rng.standard_normal((_REFERENCE_RUNS, size), dtype=np.float32)

    def search(query: FloatArray) -> IntArray:
        distances = norms - 2.0 * (rows @ query)
        nearest = np.argpartition(distances, wanted)[:wanted]
        return nearest[np.argsort(distances[nearest])]

    wall, processor = np.median(_times(search, queries), axis=0)
    return float(wall), float(processor)


def _times(work: Callable[[Any], Any], inputs: Iterable[Any]) -> NDArray[np.float64]:
    """Return wall and processor times (N, 2) of some work for its inputs, ms."""
    taken = []
    for given in inputs:
        wall_s, processor_s = time.perf_counter(), time.process_time()
        work(given)
        taken.append((time.perf_counter() - wall_s, time.process_time() - processor_s))
    return 1e3 * np.array(taken)


class _Rows:
    """Figures for one part, with the reference at that time."""

    def __init__(self) -> None:
        self.reference_ms = dict(zip(("wall", "processor"), reference_ms(), strict=True))
        self.rows: list[Row] = []

    def add(self, work: str, value: float, unit: str = "ms", goal: float | str = "", clock: str = "wall") -> None:
        """Add a figure."""
        reference = {"ms": 1.0, "s": 1e-3}.get(unit, 0.0) * self.reference_ms[clock]
        ratio: float | str = round(value / reference, 4) if reference else ""
        row = {"work": work, "value": round(value, 4), "unit": unit, "clock": clock, "goal": goal, "ratio": ratio}
        self.rows.append(row)

    def add_median(self, work: str, times_ms: NDArray[np.float64]) -> None:
        """Add the median wall and processor times."""
        for clock, value in zip(self.reference_ms, np.median(times_ms, axis=0), strict=True):
            self.add(work, float(value), clock=clock)


def _detection_and_labels(database: Database) -> list[Row]:
    """Time detection in the dark and in a furnished room, and two streams from images to labelled points."""
    source = open_simulated({"behaviour": "boxing", "fps": _STREAM_FPS, "seconds": _LEAST_S + _PAIRS / _STREAM_FPS})
    first = round(_SKIPPED_S * _STREAM_FPS)
    empty = list(source.background_frames(_EMPTY))
    sets = [source.frame(first + number) for number in range(_PAIRS)]
    rows, rng = _Rows(), np.random.default_rng(1)
    rows.add("exhaustive search in NumPy, 433,000 x 60, 32 nearest", rows.reference_ms["wall"])
    room = np.full((480, 640, 3), _ROOM_LEVEL)
    dark = learn_backgrounds((noisy(room, rng),) for _ in range(_IMAGES))[0]
    shown = [noisy(_with_markers(room, rng), rng) for _ in range(_IMAGES)]
    rows.add_median(f"detection, 640x480, {_MARKERS} markers", _times(Detector(dark).detect, shown))
    lit = learn_backgrounds((pair[0],) for pair in empty)[0]
    performer = [images.images[0] for images in sets[:: max(1, _PAIRS // _IMAGES)]]
    name = f"detection, 640x480, performer with {len(source.subject.marker_set)} markers, lit room"
    rows.add_median(name, _times(Detector(lit).detect, performer))
    pipeline = MarkerPipeline(source.rig, live_settings())
    pipeline.learn_empty(empty)
    solving = Session(source.subject, database, source.rig)
    labelling, labeller = solving.point_labels, Labeller(solving.solver.subject.torso)
    milliseconds: dict[str, list[float]] = {stage: [] for stage in STAGES}
    before, located = None, 0
    for start in range(0, len(sets), _BLOCK):
        block = sets[start : start + _BLOCK]
        clock = [time.process_time()]
        seen = [pipeline.detect(images) for images in block]
        clock.append(time.process_time())
        frames = [pipeline.locate(moment) for moment in seen]
        clock.append(time.process_time())
        poses = [solving.step(frame) for frame in frames]
        earlier = [before or poses[0], *poses[:-1]]
        labels_from_s, before = time.process_time(), poses[-1]
        for frame, pose in zip(frames, earlier, strict=True):
            labels = labelling.label_tracked(labeller, frame, pose.markers_m, 1.0 / _STREAM_FPS)
            located += int(labels.located.sum())
        for stage, seconds in zip(STAGES, [*np.diff(clock), time.process_time() - labels_from_s], strict=True):
            milliseconds[stage].append(1e3 * seconds / len(block))
    medians = {stage: float(np.median(values)) for stage, values in milliseconds.items()}
    for stage, median in medians.items():
        rows.add(f"two 640x480 streams: {stage} a pair", median, clock="processor")
    rows.add("two 640x480 streams: all stages a pair", sum(medians.values()), clock="processor")
    busier = 1e3 / max(medians["detect"] + medians["locate"], medians["label"])
    rows.add("two 640x480 streams, by the busier process", busier, "pairs/s", 240.0, "processor")
    rows.add("markers located and labelled", located / (len(sets) * len(source.subject.marker_set)), "share")
    return rows.rows


def _with_markers(room: NDArray[Any], rng: np.random.Generator) -> Image:
    image = np.asarray(room, dtype=np.uint8).copy()
    places = np.stack(np.meshgrid(80 + 160 * np.arange(4), 80 + 160 * np.arange(3)), axis=-1).reshape(-1, 2)[:_MARKERS]
    for centre in places + rng.uniform(-30.0, 30.0, places.shape):
        draw_disc(image, centre[None], _MARKER_PX, np.full(3, _MARKER_LEVEL), 0.5)
    return image


def _import(run: Run) -> tuple[Database, list[Row]]:
    """Time the import of all motion, and opening the result."""
    rows, path = _Rows(), run.path_of("speed-whole")
    settings = BuildSettings(fps=FPS, workers=run.workers)
    started_s = time.perf_counter()
    build_database(run.folders((CMU, BANDAI)), path, settings, progress=lambda share, text: run.progress(0.5, text))
    seconds = time.perf_counter() - started_s
    database = open_database(path)
    rows.add(f"import, {database.frames:,} frames, {run.workers} processes", seconds, "s")
    rows.add(f"the same by {_DATABASE_FRAMES:,} frames", seconds * _DATABASE_FRAMES / database.frames, "s", 60.0)
    opened = float(np.median(_times(open_database, [path] * 5)[:, 0]))
    rows.add("opening the database again", opened, "ms", 500.0)
    return database, rows.rows


def _part_of(run: Run, whole: Database) -> Database:
    """Return the first frames of a database, up to this number, without the takes to solve."""
    kept, left = [], _DATABASE_FRAMES
    for clip in whole.clips:
        if clip.name not in (*LEFT_OUT, SPLIT) and left > 0:
            kept.append((clip, 0, min(clip.stop - clip.start, left)))
            left -= kept[-1][2]
    return run.subset(whole, "speed", kept)


def frames_of(truth: Motion, subject: Subject) -> Iterator[MarkerFrame]:
    """Return the labelled marker frames of a motion."""
    return take_frames(simulate_markers(truth, subject)[0], subject.marker_set)


def frames_without_labels(truth: Motion, subject: Subject) -> Iterator[MarkerFrame]:
    """Yield the marker frames of a motion as cameras give them: in random order, without labels."""
    for number, frame in enumerate(frames_of(truth, subject)):
        order = np.random.default_rng(number).permutation(len(frame.points_m))
        yield MarkerFrame(frame.number, frame.time_s, frame.points_m[order], frame.covariances_m2[order])


def _solving(truth: Motion, database: Database) -> list[Row]:
    """Time the live solve of every frame of a take that is not in the database."""
    rows, subject = _Rows(), true_subject(truth)
    taken = _times(Session(subject, database).step, frames_of(truth, subject))
    for clock, milliseconds in zip(rows.reference_ms, taken.T, strict=True):
        title = f"solve of a frame, best, {database.frames:,} frames"
        rows.add(f"{title}: median", float(np.median(milliseconds)), goal=1.0, clock=clock)
        rows.add(f"{title}: p99", float(np.percentile(milliseconds, 99)), goal=2.5, clock=clock)
    return rows.rows


def _scene(database: Database) -> list[Row]:
    """Time the live solve of two performers and a sword, located in the images of two cameras."""
    source, sword = open_simulated(_SCENE), load_prop(_SCENE["prop"])
    pipeline = MarkerPipeline(source.rig, live_settings())
    pipeline.learn_empty(list(source.background_frames(_EMPTY)))
    frames = [pipeline.locate(pipeline.detect(source.frame(number))) for number in range(_TURNS)]
    skeletons = [each.motion.skeleton for each in source.performance.everybody]
    subjects = [replace(source.subject, name=str(number), skeleton=each) for number, each in enumerate(skeletons)]

    def begin() -> MultiTargetSession:
        return MultiTargetSession([Session(subject, database, source.rig) for subject in subjects], [sword])

    return _by_both_bodies("two performers and a sword", frames, begin)


def _by_both_bodies(
    title: str, frames: Sequence[MarkerFrame], begin: Callable[[], Session | MultiTargetSession]
) -> list[Row]:
    """Time the live solve of frames by the kernel and by NumPy, frame by frame in turn."""
    rows, bodies = _Rows(), {False: "NumPy", True: "kernel"} if use_kernel(True) else {}
    sessions = {is_used: begin() for is_used in bodies}
    taken: dict[bool, list[float]] = {is_used: [] for is_used in bodies}
    for number, frame in enumerate(frames):
        for is_used in sorted(bodies, reverse=bool(number % 2)):
            use_kernel(is_used)
            taken[is_used].append(_times(sessions[is_used].step, [frame])[0, 1])
    for is_used, name in bodies.items():
        milliseconds = taken[is_used][FIRST_FRAMES:]
        rows.add(f"{title}, {name}: median", float(np.median(milliseconds)), clock="processor")
        rows.add(f"{title}, {name}: p99", float(np.percentile(milliseconds, 99)), clock="processor")
    return rows.rows


def _recorded(truths: Sequence[Motion], path: Path) -> list[Row]:
    """Time solving recorded takes in both directions, with one process and with two, as in a batch.

    The takes are parts of equal length, so that no process waits long for another.
    """
    rows, parts = _Rows(), []
    for truth in truths:
        starts = range(0, truth.frames - _PART_FRAMES + 1, _PART_FRAMES)
        parts += [sliced(truth, start, start + _PART_FRAMES) for start in starts]
    for count in (1, 2):
        with ProcessPoolExecutor(count, get_context("spawn")) as pool:
            for started in [pool.submit(_solved_frames, truths[0], path, _WARM_FRAMES) for _ in range(count)]:
                started.result()
            begun_s = time.perf_counter()
            frames = sum(pool.map(_solved_frames, parts, [path] * len(parts)))
            speed = frames / (time.perf_counter() - begun_s)
        rows.add(f"recorded takes in both directions, {count} at once", speed, "frames/s", 1000.0)
    return rows.rows


_sessions = SessionCache()  # of each process


def _solved_frames(truth: Motion, path: Path, most: int | None = None) -> int:
    """Solve a take, or only its first `most` frames; return the number of frames."""
    take, subject = sliced(truth, 0, min(most or truth.frames, truth.frames)), true_subject(truth)
    markers = simulate_markers(take, subject)[0]
    solve_take(markers, subject, _sessions.database(path), SolveSettings(), no_progress, _sessions.session)
    return take.frames

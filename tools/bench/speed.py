"""Times of all stages, each beside one exhaustive search in NumPy of the same run.

The search makes figures of different machines comparable.
"""

import os
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import Database, open_database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, FloatArray, Image, IntArray
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.discs import draw_disc
from perfanim.core.solver.pose_solver import PoseSolver
from perfanim.core.solver.search.exhaustive import Query, Search
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.solver.subject_model import SubjectModel
from perfanim.core.system.assets import MOTION
from perfanim.core.system.progress import Progress, no_progress
from perfanim.core.vision.detection.background import learn_backgrounds
from perfanim.core.vision.detection.blob_detector import Detector

from .data import BANDAI, CMU, FPS, LEFT_OUT, SPLIT, UNLIKE, WALKING, data_folders, read_take
from .figure6 import true_subject
from .frame_stages import frame_stages
from .report import write_figures
from .streams import Streams, render_streams, stage_times, throughput
from .subset import write_subset
from .table1 import SEARCHES, search_times, searched, with_graph

Row = dict[str, Any]
Found = TypeVar("Found")

_REFERENCE = (433_000, 60, 32)  # rows, columns, nearest
_REFERENCE_RUNS = 15
_DATABASE_FRAMES, _SMALLER_FRAMES = 395_399, 80_000
_FIRST_FRAMES = 20  # that a session begins in
_PAIRS, _PASSES, _RUNS = 480, 2, 3
_MARKERS, _MARKER_PX, _MARKER_LEVEL, _ROOM_LEVEL, _NOISE = 12, 3.0, 220.0, 16.0, 2.0
_IMAGES = 40
_COMPARED_FRAMES, _COMPARED_EVERY = 240, 6
_WARM_FRAMES = 20  # solved by each process before recorded takes are timed


def speed(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Time the chain and write the figures.

    Processor time counts all threads of a process; for figures of one core run this with OPENBLAS_NUM_THREADS=1.

    Returns:
        rows (work, value, unit, goal or "", ratio to the reference search or ""), stages (take, database, stage of a
        frame, its time, and that as a share of the reference search's), searches (database, search, times, frames
        visited, error), machine (processors, load), outputs.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of the cameras' process, as in live capture
    cv2.setNumThreads(1)  # as there
    load_before = _load()
    rows: list[Row] = []
    progress(0.0, "drawing two streams")
    streams = render_streams(_PAIRS)
    build_database([MOTION], out / "embedded.pfdb")
    embedded = open_database(out / "embedded.pfdb")
    progress(0.1, "detection")
    rows += _detection(streams)
    progress(0.15, "images to labelled points")
    rows += _streams(streams, embedded)
    progress(0.3, "importing motion")
    whole, imported = _import(data, out, workers, lambda f, text: progress(0.3 + 0.3 * f, text))
    rows += imported
    database = part_of(whole, out / "databases" / "speed.pfdb")
    truth = read_take(data, WALKING)
    progress(0.7, "solving")
    rows += _solving(truth, database)
    smaller = part_of(whole, out / "databases" / "speed-smaller.pfdb", _SMALLER_FRAMES)
    stages: list[Row] = []
    for take in (WALKING, UNLIKE):
        motion = read_take(data, take)
        rows += compare_searches(take.title, motion, smaller)
        for used in (smaller, database):
            stages += frame_stages(take.title, motion, used, reference_ms()[1])
    progress(0.8, "solving recorded takes")
    rows += _recorded([read_take(data, take) for take in (WALKING, UNLIKE)], database.path)
    progress(0.9, "searching")
    searches = _searches(truth, with_graph(database))
    figures: dict[str, Any] = {
        "rows": rows,
        "stages": stages,
        "searches": searches,
        "machine": {"processors": os.cpu_count(), "load_before": load_before, "load_after": _load()},
    }
    return write_figures(out, "speed", figures, {"": rows, "stages": stages, "searches": searches})


def _load() -> list[float]:
    """Return the machine's load, empty if unknown: a busy machine's figures mean less."""
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

    return _median_times(search, queries)


def _median_times(work: Callable[[Any], Any], inputs: Iterable[Any]) -> tuple[float, float]:
    """Return the median wall and processor time of a work over its inputs, ms."""
    taken = []
    for given in inputs:
        wall_s, processor_s = time.perf_counter(), time.process_time()
        work(given)
        taken.append((time.perf_counter() - wall_s, time.process_time() - processor_s))
    wall, processor = 1e3 * np.median(taken, axis=0)
    return float(wall), float(processor)


class _Rows:
    """Figures of one part, beside the reference as it was then."""

    def __init__(self) -> None:
        self.wall_ms, self.processor_ms = reference_ms()
        self.rows: list[Row] = []

    def add(self, work: str, value: float, unit: str = "ms", goal: float | str = "", processor: bool = False) -> None:
        reference = {"ms": 1.0, "s": 1e-3}.get(unit, 0.0) * (self.processor_ms if processor else self.wall_ms)
        ratio: float | str = round(value / reference, 4) if reference else ""
        clock = {"clock": "processor" if processor else "wall"}
        self.rows.append(
            {"work": work, "value": round(value, 4), "unit": unit} | clock | {"goal": goal, "ratio": ratio}
        )


def _detection(streams: Streams) -> list[Row]:
    """Time marker detection in one image: in the dark, and in a furnished room."""
    rows = _Rows()
    rows.add("exhaustive search in NumPy, 433,000 x 60, 32 nearest", rows.wall_ms)
    rng = np.random.default_rng(1)
    room = np.full((480, 640, 3), _ROOM_LEVEL)
    dark = learn_backgrounds((_noisy(room, rng),) for _ in range(_IMAGES))[0]
    lit = learn_backgrounds((pair[0],) for pair in streams.empty)[0]
    shown = [_noisy(_with_markers(room, rng), rng) for _ in range(_IMAGES)]
    performer = [pair[0] for pair in streams.images[:: max(1, len(streams.images) // _IMAGES)]]
    for work, background, images in (
        (f"detection, 640x480, {_MARKERS} markers", dark, shown),
        (f"detection, 640x480, performer with {len(streams.subject.marker_set)} markers, lit room", lit, performer),
    ):
        detector = Detector(background)
        wall, processor = _median_times(detector.detect, images)
        rows.add(work, wall)
        rows.add(work, processor, processor=True)
    return rows.rows


def _with_markers(room: Array, rng: np.random.Generator) -> Image:
    image = np.asarray(room, dtype=np.uint8).copy()
    places = np.stack(np.meshgrid(80 + 160 * np.arange(4), 80 + 160 * np.arange(3)), axis=-1).reshape(-1, 2)[:_MARKERS]
    for centre in places + rng.uniform(-30.0, 30.0, places.shape):
        draw_disc(image, centre[None], _MARKER_PX, np.full(3, _MARKER_LEVEL), 0.5)
    return image


def _noisy(image: NDArray[Any], rng: np.random.Generator) -> Image:
    return np.asarray(np.clip(np.rint(image + rng.normal(0.0, _NOISE, image.shape)), 0, 255), dtype=np.uint8)


def _streams(streams: Streams, database: Database) -> list[Row]:
    """Time two streams from images to labelled points: each stage, and on two cores."""
    rows = _Rows()
    stages = stage_times(streams, database)
    for stage, milliseconds in stages.milliseconds.items():
        rows.add(f"two 640x480 streams: {stage} a pair", float(np.median(milliseconds)), processor=True)
    total = sum(np.median(milliseconds) for milliseconds in stages.milliseconds.values())
    rows.add("two 640x480 streams: all stages a pair", float(total), processor=True)
    runs = [throughput(streams, database, stages.poses, _PASSES) for _ in range(_RUNS)]
    both = [run.cameras_ms + run.labels_ms for run in runs]
    rows.add("two 640x480 streams, two processes: a pair, both", float(np.median(both)), processor=True)
    rows.add("two 640x480 streams, two processes", float(np.median([run.pairs_s for run in runs])), "pairs/s", 240.0)
    rows.add("two 640x480 streams, two processes: best run", max(run.pairs_s for run in runs), "pairs/s")
    busier = [1e3 / max(run.cameras_ms, run.labels_ms) for run in runs]
    rows.add("the same by the processor time of the busier one", float(np.median(busier)), "pairs/s", processor=True)
    rows.add("markers located and labelled", min(stages.located, *(run.located for run in runs)), "share")
    return rows.rows


def _import(data: Path, out: Path, workers: int, progress: Progress) -> tuple[Database, list[Row]]:
    """Time the import of all motion, and opening it again."""
    rows = _Rows()
    path = out / "databases" / "speed-whole.pfdb"
    started_s = time.perf_counter()
    build_database(data_folders(data, (CMU, BANDAI)), path, BuildSettings(fps=FPS, workers=workers), progress=progress)
    seconds = time.perf_counter() - started_s
    database = open_database(path)
    per_goal = _DATABASE_FRAMES / database.frames
    rows.add(f"import, {database.frames:,} frames, {workers} processes", seconds, "s")
    rows.add(f"the same by {_DATABASE_FRAMES:,} frames", seconds * per_goal, "s", 60.0)
    wall, _ = _median_times(open_database, [path] * 5)
    rows.add("opening the database again", wall, "ms", 500.0)
    return database, rows.rows


def part_of(whole: Database, path: Path, frames: int | None = None) -> Database:
    """Return the chosen part of the database, without the takes to solve."""
    kept, left = [], frames or _DATABASE_FRAMES
    clips = [clip for clip in whole.clips if clip.name not in (*LEFT_OUT, SPLIT)]
    for clip in clips:
        count = min(clip.stop - clip.start, left)
        if count > 0:
            kept.append((clip, 0, count))
            left -= count
    return write_subset(whole, path, kept)


class _TimedSearch:
    """A search that keeps account of its time."""

    def __init__(self, search: Search) -> None:
        self._search = search
        self.visited = 0
        self.seconds = 0.0

    def nearest(self, query: Query, count: int, start: IntArray | None = None) -> tuple[IntArray, Array]:
        """Return the closest frames."""
        return self._timed(self._search.nearest, query, count, start)

    def near(self, query: Query, count: int, start: IntArray | None = None) -> IntArray:
        """Return frames near a query."""
        return self._timed(self._search.near, query, count, start)

    def nearest_among(self, query: Query, candidates: IntArray) -> tuple[IntArray, Array]:
        """Return candidates by distance."""
        return self._timed(self._search.nearest_among, query, candidates)

    def _timed(self, work: Callable[..., Found], *arguments: Any) -> Found:
        started_s = time.perf_counter()
        found = work(*arguments)
        self.seconds += time.perf_counter() - started_s
        self.visited = self._search.visited
        return found


def _solving(truth: Motion, database: Database) -> list[Row]:
    """Time the solve of every frame of a take, recorded and live.

    The take is not in the database.
    """
    rows = _Rows()
    subject = true_subject(truth)
    frames = list(take_frames(simulate_markers(truth, subject)[0], subject.marker_set))
    session = Session(subject, database)
    search = _TimedSearch(session.solver._locator._search)
    session.solver._locator._search = search
    taken = []
    for frame in frames:
        wall_s, processor_s, searched_s = time.perf_counter(), time.process_time(), search.seconds
        session.step(frame)
        taken.append((time.perf_counter() - wall_s, time.process_time() - processor_s, search.seconds - searched_s))
    wall, processor, searching = 1e3 * np.array(taken).T
    title = f"solve of a frame, best, {database.frames:,} frames"
    for name, milliseconds, is_processor in ((title, wall, False), (title, processor, True)):
        rows.add(f"{name}: median", float(np.median(milliseconds)), goal=1.0, processor=is_processor)
        rows.add(f"{name}: p99", float(np.percentile(milliseconds, 99)), goal=2.5, processor=is_processor)
    rows.add("the search in it: median", float(np.median(searching)))
    rows.add("the search in it: p99", float(np.percentile(searching, 99)))
    rows.add("the search in it: share", float(searching.sum() / wall.sum()), "share")
    return rows.rows


def _recorded(truths: Sequence[Motion], path: Path) -> list[Row]:
    """Time recorded takes in both directions, by one process and by two.

    A solver's preparation for each take counts.
    """
    rows = _Rows()
    for count in (1, 2):
        with ProcessPoolExecutor(count, get_context("spawn")) as pool:
            for started in [pool.submit(_solved_frames, truths[0], path, _WARM_FRAMES) for _ in range(count)]:
                started.result()
            begun_s = time.perf_counter()
            frames = sum(pool.map(_solved_frames, truths, [path] * len(truths)))
            speed = frames / (time.perf_counter() - begun_s)
        rows.add(f"recorded takes in both directions, {count} at once", speed, "frames/s", 2000.0)
    return rows.rows


def _solved_frames(truth: Motion, path: Path, most: int | None = None) -> int:
    """Return the number of frames of a take solved, those at its beginning at most."""
    take, subject = sliced(truth, 0, min(most or truth.frames, truth.frames)), true_subject(truth)
    solve_take(simulate_markers(take, subject)[0], subject, open_database(path), SolveSettings(), no_progress)
    return take.frames


def compare_searches(title: str, truth: Motion, database: Database) -> list[Row]:
    """Time every frame of a take by the default search and the exhaustive one in turn."""
    rows = _Rows()
    subject = true_subject(truth)
    frames = list(take_frames(simulate_markers(truth, subject)[0], subject.marker_set))[:_COMPARED_FRAMES]
    names = ("exhaustive", "auto")
    sessions = {name: Session(subject, database, settings=SolveSettings(search=name)) for name in names}
    taken: dict[str, list[float]] = {name: [] for name in names}
    apart = []
    for number, frame in enumerate(frames):
        poses = {}
        for name in names if number % 2 else names[::-1]:
            started_s = time.process_time()
            poses[name] = sessions[name].step(frame)
            taken[name].append(1e3 * (time.process_time() - started_s))
        apart.append(rot.angle_between(*(poses[name].rotations[1:] for name in names)).mean())
    medians = {}
    for name in names:
        milliseconds = taken[name][_FIRST_FRAMES:]
        medians[name] = float(np.median(milliseconds))
        work = f"solve of a frame, {title}, {database.frames:,} frames, search {name}"
        rows.add(f"{work}: median", medians[name], processor=True)
        rows.add(f"{work}: p99", float(np.percentile(milliseconds, 99)), processor=True)
    rows.add(f"the same, {title}: auto of exhaustive", medians["auto"] / medians["exhaustive"], "share", processor=True)
    rows.add(f"the same, {title}: poses apart", float(np.degrees(np.mean(apart))), "deg/joint")
    return rows.rows


def _searches(truth: Motion, database: Database) -> list[Row]:
    """Time each search, and compare its poses with those of the exhaustive one."""
    subject = true_subject(truth)
    model = SubjectModel(subject, database.reference_pose_of(subject.skeleton, subject.name))
    markers = simulate_markers(truth, subject)[0].positions_m[:_COMPARED_FRAMES]
    exhaustive = PoseSolver(model, database, SolveSettings(search="exhaustive"))
    errors = {
        name: searched(PoseSolver(model, database, SolveSettings(search=name)), exhaustive, markers, _COMPARED_EVERY)
        for name in SEARCHES
    }
    columns = 3 * len(subject.marker_set) + int(np.prod(database.poses.shape[1:]))
    return [
        {"database_frames": database.frames, "columns": columns}
        | times
        | {
            "frames_visited": errors[times["search"]]["mean"] if times["search"] in errors else database.frames,
            "deg_per_joint": errors[times["search"]]["deg_per_joint"] if times["search"] in errors else 0.0,
        }
        for times in search_times(truth, database)
    ]

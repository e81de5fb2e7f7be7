"""Motion, a database without one clip, and the person of that clip with markers and two cameras: built once."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from bench.subset import write_database
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.database.file_selection import behaviour_of
from perfanim.core.database.store import Clip, Database, open_database
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry.camera import WORLD_FROM_CAMERA, Camera, CameraRig
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.solver.subject_model import SubjectModel
from perfanim.core.system.assets import MOTION

FPS = 30.0
HELD_OUT = "walking-02-energetic"
CLIPS = ("boxing-0[1-4]*", "jumping-0[1-2]*", "running-0[1-4]*", "walking-0*")


def write_motions(path: Path, motions: list[Motion]) -> Database:
    """Return a database of motions, each a clip with a skeleton of its own."""
    edges = np.concatenate(([0], np.cumsum([motion.frames for motion in motions])))
    clips = [
        Clip(motion.name, behaviour_of(motion.name), motion.name, motion.fps, int(edges[i]), int(edges[i + 1]), i)
        for i, motion in enumerate(motions)
    ]
    write_database(
        path,
        motions[0].fps,
        np.concatenate([motion.rotations for motion in motions]),
        np.concatenate([motion.root_positions_m for motion in motions]),
        clips,
        [motion.skeleton for motion in motions],
    )
    return open_database(path)


@pytest.fixture(scope="session")
def database_of() -> Callable[[Path, list[Motion]], Database]:
    """database_of(path, motions) -> the database written there."""
    return write_motions


@pytest.fixture(scope="session")
def embedded_motion() -> dict[str, Motion]:
    """Some of the shipped clips by name, at 30 frames per second."""
    files = sorted(path for pattern in CLIPS for path in MOTION.glob(f"{pattern}.bvh"))
    return {path.stem: resampled(read_motion(path), FPS) for path in files}


@pytest.fixture(scope="session")
def database_file(embedded_motion: dict[str, Motion], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Database of the clips but the one left out."""
    path = tmp_path_factory.mktemp("database") / "small.db"
    write_motions(path, [motion for name, motion in embedded_motion.items() if name != HELD_OUT])
    return path


@pytest.fixture(scope="session")
def database(database_file: Path) -> Database:
    """The opened database."""
    return open_database(database_file)


@pytest.fixture(scope="session")
def truth(embedded_motion: dict[str, Motion]) -> Motion:
    """Two seconds of the clip that is not in the database."""
    return sliced(embedded_motion[HELD_OUT], 20, 80)


@pytest.fixture(scope="session")
def boxing(embedded_motion: dict[str, Motion]) -> Motion:
    """A clip of a boxer."""
    return next(motion for name, motion in embedded_motion.items() if name.startswith("boxing"))


@pytest.fixture(scope="session")
def subject(truth: Motion) -> Subject:
    """The person of that clip with the eight markers of locomotion."""
    return Subject("walker", truth.skeleton, load_marker_set("locomotion"))


@pytest.fixture(scope="session")
def model(subject: Subject, database: Database) -> SubjectModel:
    """The person's markers as a function of the database's poses."""
    return SubjectModel(subject, database.reference_pose_of(subject.skeleton))


@pytest.fixture(scope="session")
def true_markers(subject: Subject, truth: Motion) -> np.ndarray:
    """(F, M, 3) where the markers are."""
    return subject.marker_set.positions_on(truth.skeleton, truth.rotations, truth.root_positions_m)


@pytest.fixture(scope="session")
def stage_rig(true_markers: np.ndarray) -> CameraRig:
    """Two cameras before the person, 1.2 m apart, 4 m away, with lens distortion."""
    middle = np.nanmean(true_markers, axis=(0, 1)) + np.array([0.0, 0.0, 4.0])
    matrix = np.array([[620.0, 0.0, 322.0], [0.0, 618.0, 236.0], [0.0, 0.0, 1.0]])
    cameras = []
    for name, side in (("left", -0.6), ("right", 0.6)):
        centre = middle + np.array([side, 0.0, 0.0])
        toe_in = np.arctan2(side, 4.0)
        turn = np.array([[np.cos(toe_in), 0, np.sin(toe_in)], [0, 1, 0], [-np.sin(toe_in), 0, np.cos(toe_in)]])
        rotation = turn @ WORLD_FROM_CAMERA
        lens = np.array([-0.12, 0.05, 0.001, -0.0005, 0.0])
        cameras.append(Camera(name, (640, 480), matrix, lens, rotation, -rotation @ centre))
    return CameraRig(tuple(cameras))


@dataclass(frozen=True)
class _Recorder:
    """Makes marker frames of points."""

    rig: CameraRig

    def __call__(
        self,
        points_m: np.ndarray,
        number: int = 0,
        labels: np.ndarray | None = None,
        sigma_m: float = 0.001,
        hidden: tuple[tuple[int, int], ...] = (),
        cameras: bool = False,
        fps: float = FPS,
    ) -> MarkerFrame:
        """Return the frame of points (M, 3), rows with NaN left out.

        `hidden` are (row, camera) pairs that a camera does not see; `cameras` adds what the cameras see, without which
        only points are given.
        """
        rows = np.flatnonzero(np.isfinite(points_m[:, 0]))
        seen = {index: [r for r in rows if (r, index) not in hidden] for index in range(len(self.rig))}
        both = np.array([r for r in rows if all(r in seen[index] for index in seen)], dtype=np.int64)
        alone = [(r, index) for index in seen for r in seen[index] if r not in both]
        known = np.full(len(points_m), -1) if labels is None else np.asarray(labels)
        views = self.rig.cameras if cameras else ()
        blobs = [np.zeros((len(seen[i]), 5), dtype=np.float32) for i in range(len(views))]
        for index, camera in enumerate(views):
            blobs[index][:, :2] = camera.project(points_m[seen[index]])
            blobs[index][:, 2:] = 4.0, 200.0, 0.0
        single = np.array([self.rig.cameras[i].undistort(self.rig.cameras[i].project(points_m[r])) for r, i in alone])
        places = np.array([[seen[i].index(r) for i in range(len(views))] for r in both])
        return MarkerFrame(
            number,
            number / fps,
            points_m[both],
            np.tile(sigma_m**2 * np.eye(3), (len(both), 1, 1)),
            known[both],
            tuple(blobs),
            point_blobs=places.reshape(len(both), len(views)),
            single_cameras=np.array([index for _, index in alone], dtype=np.int64),
            single_blobs=np.array([seen[index].index(r) for r, index in alone], dtype=np.int64),
            single_points=single.reshape(-1, 2),
            single_labels=np.array([known[r] for r, _ in alone], dtype=np.int64),
        )


@pytest.fixture(scope="session")
def record(stage_rig: CameraRig) -> Callable[..., MarkerFrame]:
    """record(points_m, number=0, labels=None, ...) -> the marker frame that shows them."""
    return _Recorder(stage_rig)

"""Simulated recordings on disk: videos, background, board pictures and the ground truth."""

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...errors import CaptureError
from ...formats.motion.bvh import write_bvh
from ...geometry.arrays import Image
from ...geometry.npz import write_arrays
from ...geometry.rig_file import save_rig
from ...markers.marker_take import MarkerTake, save_take
from ...markers.subject import save_subject
from ...system.files import writing
from ...system.progress import Progress, no_progress
from .boards import DEFAULT_BOARD, board_pictures
from .render import FrameTruth
from .simulated_source import SimulatedSource
from .video import LOSSLESS, open_video

_Write = Callable[[Sequence[Image]], None]


@dataclass(frozen=True)
class RecordingFiles:
    """Contents of a recording in addition to the performance: background, board, codec."""

    background_frames: int = 60
    board_views: int = 24
    extension: str = LOSSLESS[0]
    codec: str = LOSSLESS[1]


def export_recording(
    source: SimulatedSource, out: str | Path, files: RecordingFiles | None = None, progress: Progress = no_progress
) -> dict[str, Any]:
    """Write a simulated recording to a new folder and return a summary.

    For each camera NAME, the folder contains `NAME.mkv`, `background/NAME.mkv` and `board/NAME/000.png`, ...; its
    folder `truth` contains cameras.toml, subject.toml, motion.bvh, markers.take.npz, image_truth.npz and
    board_truth.npz. The new folder appears only once it is complete.

    Raises:
        CaptureError: The folder exists and is not empty, or it cannot be written.
    """
    files = files or RecordingFiles()
    names = [camera.name for camera in source.rig.cameras]
    with _new_folder(Path(out)) as folder:
        for sub in ("truth", "background", *(f"board/{name}" for name in names)):
            (folder / sub).mkdir(parents=True)
        _write_board(source, folder, files.board_views, progress)
        with _videos(source, folder / "background", files) as write:
            for number, images in enumerate(source.background_frames(files.background_frames)):
                progress(0.15 + 0.05 * number / files.background_frames, "taking images of the empty room")
                write(images)
        truths = []
        with _videos(source, folder, files) as write:
            for frame in source:
                progress(0.2 + 0.8 * frame.number / source.frames, "taking images of the performer")
                write(frame.images)
                truths.append(frame.truth)
        _write_truth(source, folder / "truth", truths)
    visible = np.array([truth.visible for truth in truths])
    return {
        "frames": len(truths),
        "fps": source.fps,
        "cameras": names,
        "time_offsets_ms": [1e3 * offset_s for offset_s in _time_offsets_s(source)],
        "markers": list(source.performance.marker_names),
        "visible_in_two_fraction": float((visible.sum(axis=1) >= 2).mean()),
        "hidden_fraction": float((~visible).mean()),
        "board": f"chessboard:{DEFAULT_BOARD.columns}x{DEFAULT_BOARD.rows}:{DEFAULT_BOARD.square_m * 1e3:g}mm",
        "board_views": files.board_views,
        "out": str(out),
    }


@contextmanager
def _new_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder that becomes `target` at the end, or is removed after an error."""
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise CaptureError("exists and is not an empty folder", where=str(target), advice="give a new folder")
    with writing(target, "choose another folder", CaptureError):
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    try:
        with writing(target, "check the disk", CaptureError):
            yield temporary
            if target.exists():
                target.rmdir()
            temporary.chmod(0o755)
            temporary.rename(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _write_board(source: SimulatedSource, folder: Path, views: int, progress: Progress) -> None:
    pictures = []
    for picture in board_pictures(source.renderer, DEFAULT_BOARD, views) if views else ():
        progress(0.15 * picture.number / views, "taking pictures of the board")
        for camera, image in zip(source.rig.cameras, picture.images, strict=True):
            cv2.imwrite(str(folder / "board" / camera.name / f"{picture.number:03d}.png"), image)
        pictures.append(picture)
    write_arrays(
        folder / "truth" / "board_truth.npz",
        {
            "corners_px": [picture.corners for picture in pictures],
            "world_from_board": [picture.pose.world_from_board for picture in pictures],
            "positions_m": [picture.pose.position_m for picture in pictures],
            "points_m": DEFAULT_BOARD.points_m,
        },
    )


@contextmanager
def _videos(source: SimulatedSource, folder: Path, files: RecordingFiles) -> Iterator[_Write]:
    """Yield a function that appends an image set to one video per camera."""
    with ExitStack() as stack:
        writers = [
            stack.enter_context(
                open_video(folder / f"{camera.name}{files.extension}", source.fps, camera.image_size, files.codec)
            )
            for camera in source.rig.cameras
        ]

        def write(images: Sequence[Image]) -> None:
            for writer, image in zip(writers, images, strict=True):
                writer(image)

        yield write


def _write_truth(source: SimulatedSource, folder: Path, truths: list[FrameTruth]) -> None:
    save_rig(source.rig, folder / "cameras.toml")
    save_subject(source.subject, folder / "subject.toml")
    write_bvh(source.motion, folder / "motion.bvh")
    take = MarkerTake(
        name=source.motion.name,
        fps=source.fps,
        names=source.performance.marker_names,
        positions_m=np.array([truth.markers_m for truth in truths]),
        frame_numbers=np.array([truth.number for truth in truths]),
        times_s=np.array([truth.time_s for truth in truths]),
    )
    save_take(take, folder / "markers.take.npz")
    write_arrays(
        folder / "image_truth.npz",
        {
            "cameras": [camera.name for camera in source.rig.cameras],
            "markers": source.performance.marker_names,
            "pixels": [truth.pixels for truth in truths],
            "radii_px": [truth.radii_px for truth in truths],
            "visible": [truth.visible for truth in truths],
            "times_s": [truth.time_s for truth in truths],
            "time_offsets_s": _time_offsets_s(source),
            "rolling_shutter_s": source.renderer.settings.rolling_shutter_s,
        },
    )


def _time_offsets_s(source: SimulatedSource) -> list[float]:
    """Return the delay of each camera relative to the frames of its video."""
    return [source.renderer.settings.time_offset_s(i) for i in range(len(source.rig))]

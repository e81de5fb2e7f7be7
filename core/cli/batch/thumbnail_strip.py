"""Picture of a solved take: a row of poses above a confidence bar."""

from pathlib import Path

import cv2
import numpy as np

from ...body.skeleton import forward_kinematics
from ...errors import FormatError
from ...geometry.arrays import Image
from ...session.solved_take import SolvedTake
from ...session.verdict import is_unsolved
from ...simulate.preview import CharacterPainter, floor_image, preview_camera

_POSES = 6
_CELL = (96, 124)  # width and height, pixels
_DRAWN = (144, 186)  # pixels; drawn larger and reduced afterwards, so that edges are smooth
_BAR = 7  # height, pixels
_QUALITY = 75  # JPEG quality
_SOLE_M = 0.03  # height of a foot joint above the floor
# BGR for confidence 0, 0.5 and 1, and for frames without a pose
_COLOURS = np.array([[60.0, 60.0, 200.0], [60.0, 190.0, 235.0], [90.0, 175.0, 90.0]])
_UNSOLVED = (30.0, 30.0, 30.0)


def write_strip(solved: SolvedTake, path: Path) -> None:
    """Write the picture of a take as a JPEG.

    Raises:
        FormatError: The picture cannot be written.
    """
    done, data = cv2.imencode(".jpg", np.vstack((_poses(solved), _bar(solved))), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise FormatError("the picture could not be encoded", where=str(path), advice="report this")
    path.write_bytes(data.tobytes())


def _poses(solved: SolvedTake) -> Image:
    """Return poses at equal time intervals next to each other, each centred in its cell."""
    motion = solved.motion
    camera = preview_camera([0.0, 1.0, 0.0], _DRAWN)
    stage, painter = floor_image(camera), CharacterPainter(camera, motion.skeleton)
    shown = ((np.arange(_POSES) + 0.5) / _POSES * motion.frames).astype(int)
    rotations, heights = motion.rotations[shown], motion.root_positions_m[shown, 1]
    lowest = forward_kinematics(motion.skeleton, rotations, motion.root_positions_m[shown])[0][..., 1].min()
    cells = []
    for pose, height in zip(rotations, heights, strict=True):
        cell = stage.copy()
        painter.draw(cell, pose, np.array([0.0, height - lowest + _SOLE_M, 0.0]))
        cells.append(cv2.resize(cell, _CELL, interpolation=cv2.INTER_AREA))
    return np.hstack(cells)


def _bar(solved: SolvedTake) -> Image:
    """Return a bar of the lowest confidence over time, black where there is no pose."""
    width = _POSES * _CELL[0]
    poses = solved.poses_of()
    times_s = np.array([pose.time_s for pose in poses])
    edges_s = np.linspace(times_s.min(), times_s.max(), width + 1)
    edges = np.append(np.searchsorted(times_s, edges_s)[:-1], len(poses))
    confidence = np.array([pose.confidence for pose in poses])
    unsolved = is_unsolved(poses)
    row = np.empty((width, 3))
    for column in range(width):
        first = min(int(edges[column]), len(poses) - 1)
        part = slice(first, max(int(edges[column + 1]), first + 1))
        colour = [np.interp(confidence[part].min(), (0.0, 0.5, 1.0), channel) for channel in _COLOURS.T]
        row[column] = _UNSOLVED if unsolved[part].any() else colour
    return np.broadcast_to(np.rint(row).astype(np.uint8), (_BAR, width, 3))

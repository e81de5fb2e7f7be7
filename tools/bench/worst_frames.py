"""The worst frames, and pictures of the truth beside the solved pose."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.system.files import atomic_path

from .plots import check_plots

_LISTED = 20  # of each check
_DRAWN = 24
_COLUMNS = 4  # frames in a row
_SHOWN_M = 1.1  # about the root, each way
_LEFT, _RIGHT, _MIDDLE = "#1f5fd0", "#d02a2a", "#111111"


class Picture(NamedTuple):
    """Motions of one frame: the truth, and as it was solved."""

    title: str
    truth: Motion
    solved: Motion


class WorstFrames(NamedTuple):
    """Values of single frames, and pictures of some with their errors."""

    frames: list[dict[str, Any]]
    pictures: list[tuple[float, Picture]]

    def add(self, check: str, take: str, frame: int, joint: str, value: float) -> None:
        """Add the value of a frame."""
        row = {"check": check, "take": take, "frame": frame, "joint": joint, "value": round(float(value), 4)}
        self.frames.append(row)

    def add_picture(self, title: str, error: float, truth: Motion, solved: Motion, frame: int) -> None:
        """Add a frame to be drawn, with its error in degrees per joint."""
        one = Picture(f"{title}: {error:.0f} deg", *(sliced(motion, frame, frame + 1) for motion in (truth, solved)))
        self.pictures.append((error, one))

    def listed(self) -> list[dict[str, Any]]:
        """Return the largest values of each check, without those that harm nobody."""
        checks = dict.fromkeys(frame["check"] for frame in self.frames)
        ordered = sorted((frame for frame in self.frames if frame["value"] > 0.0), key=lambda frame: -frame["value"])
        return [frame for check in checks for frame in [f for f in ordered if f["check"] == check][:_LISTED]]

    def drawn(self) -> list[Picture]:
        """Return the worst pictures, worst first."""
        return [picture for _, picture in sorted(self.pictures, key=lambda pair: -pair[0])[:_DRAWN]]


def write_pictures(path: Path, pictures: Sequence[Picture]) -> list[Path]:
    """Write the pictures to `path` as .png, the truth at the left of each pair."""
    if not pictures:
        return []
    check_plots()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = -(-len(pictures) // _COLUMNS)
    figure = Figure(figsize=(4.0 * _COLUMNS, 2.8 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, 2 * _COLUMNS, squeeze=False)
    for axes in grid.ravel():
        axes.set_axis_off()
    for number, picture in enumerate(pictures):
        row, column = divmod(number, _COLUMNS)
        heading = rot.rotate(picture.truth.rotations[0, 0], np.array([0.0, 0.0, 1.0]))
        for side, motion in enumerate((picture.truth, picture.solved)):
            _draw(grid[row, 2 * column + side], motion, heading)
        grid[row, 2 * column].set_title(picture.title, fontsize=7, loc="left")
    target = path.with_suffix(".png")
    with atomic_path(target) as temporary:
        figure.savefig(temporary, dpi=110, format="png")
    return [target]


def _draw(axes: Any, motion: Motion, heading: Array) -> None:
    """Draw a pose half from the front of the truth."""
    skeleton = motion.skeleton
    joints, _ = forward_kinematics(skeleton, motion.rotations[0], motion.root_positions_m[0])
    angle = np.arctan2(heading[0], heading[2]) + 0.5
    across = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    places = np.column_stack(((joints - joints[0]) @ across, joints[:, 1] - joints[0, 1]))
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            name = skeleton.names[joint]
            colour = {"l": _LEFT, "r": _RIGHT}.get(name[0], _MIDDLE) if name != "lowerback" else _MIDDLE
            axes.plot(*places[[parent, joint]].T, color=colour, linewidth=1.4)
    axes.set_aspect("equal")
    axes.set_xlim(-0.7 * _SHOWN_M, 0.7 * _SHOWN_M)
    axes.set_ylim(-_SHOWN_M, _SHOWN_M)

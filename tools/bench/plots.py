"""Plots like the paper's as SVG and PNG, and pictures of poses next to the true ones."""

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.errors import SettingsError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.system.files import atomic_path

_COLOURS = ("#2a9d3a", "#1f5fd0", "#d02a2a", "#8a4fbf", "#111111")
_COLUMNS = 4  # pairs of pictures in a row
_SHOWN_M = 1.1  # half the height of a picture, around the root
_LEFT, _RIGHT, _MIDDLE = "#1f5fd0", "#d02a2a", "#111111"


class Line(NamedTuple):
    """A curve in a plot."""

    name: str
    x: NDArray[Any]
    y: NDArray[Any]
    paper: tuple[float, float] | None = None  # the paper's value to compare with


class Panel(NamedTuple):
    """One of the plots shown side by side."""

    title: str
    lines: Sequence[Line]
    limit: float | None = None  # y at which a dashed line is drawn
    top: float | None = None  # largest y that is shown


class Picture(NamedTuple):
    """The true pose and the solved one."""

    title: str
    truth: Motion
    solved: Motion

    @classmethod
    def of(cls, title: str, truth: Motion, solved: Motion, frame: int) -> "Picture":
        """Return the picture of one frame of two motions."""
        return cls(title, *(sliced(motion, frame, frame + 1) for motion in (truth, solved)))


def check_plots() -> None:
    """Raise SettingsError with advice if the plotting library is missing."""
    if importlib.util.find_spec("matplotlib") is None:
        advice = "install it: pip install 'perfanim[plots]'"
        raise SettingsError("plots need matplotlib, which is missing", advice=advice)


def write_plot(path: Path, panels: Sequence[Panel], x_label: str, y_label: str, markers: bool = False) -> list[Path]:
    """Write panels side by side to `path` as .svg and .png; return both paths."""
    figure = _figure(5.2 * len(panels), 4.0)
    for axes, panel in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels, strict=True):
        for line, colour in zip(panel.lines, _COLOURS, strict=False):
            marker = "o" if markers else None
            axes.plot(line.x, line.y, color=colour, linewidth=1.1, label=line.name, marker=marker, markersize=3)
            if line.paper is not None:
                axes.plot(*line.paper, color=colour, linestyle="none", marker="s", markersize=7, fillstyle="none")
        if any(line.paper is not None for line in panel.lines):
            axes.plot([], [], color="grey", linestyle="none", marker="s", fillstyle="none", label="the paper's")
        if panel.limit is not None:
            axes.axhline(panel.limit, color="grey", linewidth=0.8, linestyle="--")
        axes.set_title(panel.title, fontsize=10)
        axes.set(xlabel=x_label, ylabel=y_label)
        axes.set_ylim(bottom=0.0, top=panel.top)
        axes.margins(x=0.01)
        axes.legend(fontsize=8, frameon=False)
    return [_saved(figure, path.with_suffix(suffix), 150) for suffix in (".svg", ".png")]


def write_pictures(path: Path, pictures: Sequence[Picture]) -> list[Path]:
    """Write pictures of poses to `path` as .png, with the truth on the left of each pair."""
    if not pictures:
        return []
    rows = -(-len(pictures) // _COLUMNS)
    figure = _figure(4.0 * _COLUMNS, 2.8 * rows)
    grid = figure.subplots(rows, 2 * _COLUMNS, squeeze=False)
    for axes in grid.ravel():
        axes.set_axis_off()
    for number, picture in enumerate(pictures):
        row, column = divmod(number, _COLUMNS)
        heading = rot.rotate(picture.truth.rotations[0, 0], np.array([0.0, 0.0, 1.0]))
        for side, motion in enumerate((picture.truth, picture.solved)):
            _draw_pose(grid[row, 2 * column + side], motion, heading)
        grid[row, 2 * column].set_title(picture.title, fontsize=7, loc="left")
    return [_saved(figure, path.with_suffix(".png"), 110)]


def _draw_pose(axes: Any, motion: Motion, heading: Array) -> None:
    """Draw a pose, seen from slightly beside the front of the truth."""
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
    axes.set(xlim=(-0.7 * _SHOWN_M, 0.7 * _SHOWN_M), ylim=(-_SHOWN_M, _SHOWN_M))


def _figure(width: float, height: float) -> Any:
    check_plots()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _saved(figure: Any, path: Path, dpi: int) -> Path:
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=dpi, format=path.suffix[1:])
    return path

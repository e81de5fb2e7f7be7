"""Plots like those of the paper, as SVG and PNG."""

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from perfanim.core.errors import SettingsError
from perfanim.core.system.files import atomic_path

_COLOURS = ("#2a9d3a", "#1f5fd0", "#d02a2a", "#8a4fbf", "#111111")


@dataclass(frozen=True)
class Line:
    """A curve of a plot.

    Args:
        x, y: (N,) each.
        paper: (x, y) of the paper's value beside it, None where it gives none.
    """

    name: str
    x: NDArray[Any]
    y: NDArray[Any]
    paper: tuple[float, float] | None = None


@dataclass(frozen=True)
class Panel:
    """One of the plots that stand side by side.

    Args:
        limit: y at which a dashed line is drawn, None without.
        top: largest y that is shown, None for all.
    """

    title: str
    lines: Sequence[Line]
    limit: float | None = None
    top: float | None = None


def check_plots() -> None:
    """Raise SettingsError with advice when the library that plots is missing."""
    if importlib.util.find_spec("matplotlib") is None:
        raise SettingsError(
            "plots need matplotlib, which is missing", advice="install it: pip install 'perfanim[plots]'"
        )


def write_plot(path: Path, panels: Sequence[Panel], x_label: str, y_label: str, markers: bool = False) -> list[Path]:
    """Write panels side by side to `path` as .svg and .png; return both paths."""
    check_plots()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2 * len(panels), 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, panel in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels, strict=True):
        for line, colour in zip(panel.lines, _COLOURS, strict=False):
            axes.plot(
                line.x, line.y, color=colour, linewidth=1.1, label=line.name,
                marker="o" if markers else None, markersize=3,
            )  # fmt: skip
            if line.paper is not None:
                axes.plot(*line.paper, color=colour, linestyle="none", marker="s", markersize=7, fillstyle="none")
        if any(line.paper is not None for line in panel.lines):
            axes.plot([], [], color="grey", linestyle="none", marker="s", fillstyle="none", label="the paper's")
        if panel.limit is not None:
            axes.axhline(panel.limit, color="grey", linewidth=0.8, linestyle="--")
        axes.set_title(panel.title, fontsize=10)
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.set_ylim(bottom=0.0, top=panel.top)
        axes.margins(x=0.01)
        axes.legend(fontsize=8, frameon=False)
    written = []
    for suffix in (".svg", ".png"):
        target = path.with_suffix(suffix)
        with atomic_path(target) as temporary:
            figure.savefig(temporary, dpi=150)
        written.append(target)
    return written

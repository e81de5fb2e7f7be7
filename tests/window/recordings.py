"""Pictures as two cameras record them, rendered by the simulated studio."""

from pathlib import Path

import cv2
from perfanim.core.simulate.studio.boards import board_pictures
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import SimulatedSource, open_simulated

SIDES = ("left", "right")


def record_walk(folder: Path, seconds: float, numbers: range) -> SimulatedSource:
    """Write numbered pictures of a walking performer, 60 a second, into the folders `left` and `right`."""
    source = open_simulated({"kind": "simulated", "behaviour": "walking", "seconds": seconds})
    for number in numbers:
        _write(folder, f"{number}.jpg", source.frame(number).images)
    return source


def record_board(folder: Path, renderer: Renderer, count: int) -> None:
    """Write pictures of a board of 9x6 inner corners into the folders `left` and `right`."""
    for picture in board_pictures(renderer, count=count):
        _write(folder, f"{picture.number}.png", picture.images)


def _write(folder: Path, name: str, images: tuple[object, ...]) -> None:
    for side, image in zip(SIDES, images, strict=True):
        (folder / side).mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(folder / side / name), image)

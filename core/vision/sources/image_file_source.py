"""Image files as a source: one folder or pattern per camera, paired by number."""

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...errors import CaptureError, counted
from ...geometry.arrays import Image
from .image_files import list_images, pair_by_number, read_image
from .image_set import ClosableSource, ImageSet

# the time of day in file names that cameras write: 14-57-01~73, 10-21-36%593, 10-21-36.593
_TIME_OF_DAY = re.compile(r"(?<!\d)(\d{1,2})-(\d{2})-(\d{2})[~%.,](\d+)")


class ImageFileSource(ClosableSource):
    """Image sets from files; can be iterated any number of times.

    Args:
        patterns: A folder, a pattern or a file for each camera.
        fps: Rate to use if the names do not contain times.

    Attributes:
        warnings: Files that were left out.

    Raises:
        CaptureError: There are no files, they cannot be paired, or, during iteration, an image is unreadable.
    """

    def __init__(self, patterns: Sequence[str | Path], fps: float = 30.0) -> None:
        lists = [list_images(pattern) for pattern in patterns]
        alone: list[tuple[int, tuple[Path, ...]]] = [(number, (path,)) for number, path in enumerate(lists[0])]
        self._pairs, leftover = pair_by_number(lists) if len(lists) > 1 else (alone, [])
        self.warnings: tuple[str, ...] = ()
        if leftover:
            names = ", ".join(path.name for path in leftover[:3]) + (" ..." if len(leftover) > 3 else "")
            self.warnings = (f"left out {counted(len(leftover), 'picture')} without a partner: {names}",)
        self.name = lists[0][0].parent.name
        self._times = _times_from_names([paths[0] for _, paths in self._pairs])
        if self._times is not None:
            steps = np.diff(self._times)
            # pauses are left out, because programs sometimes write single frames late
            fps = float(1.0 / np.mean(steps[steps <= 4.0 * np.median(steps)]))
        self.fps = fps
        self.frames = len(self._pairs)

    def frame(self, index: int) -> ImageSet:
        """Return an image set by its index."""
        number, paths = self._pairs[index]
        first = self._pairs[0][0]
        time_s = self._times[index] if self._times is not None else (number - first) / self.fps
        images = tuple(read_image(path) for path in paths)
        return ImageSet(number, (float(time_s),) * len(paths), images)

    def __iter__(self) -> Iterator[ImageSet]:
        for index in range(self.frames):
            if self._closed:
                return
            yield self.frame(index)

    def samples(self, count: int) -> Iterator[tuple[Image, ...]]:
        """Yield the images of up to `count` moments spread over the whole source."""
        for index in np.unique(np.linspace(0, self.frames - 1, count).astype(int)):
            yield self.frame(int(index)).images


def _times_from_names(paths: Sequence[Path]) -> list[float] | None:
    """Return seconds since the first file, or None if the names do not contain increasing times."""
    times = []
    for path in paths:
        match = _TIME_OF_DAY.search(path.stem)
        if match is None:
            return None
        hours, minutes, seconds, fraction = match.groups()
        times.append(int(hours) * 3600 + int(minutes) * 60 + int(seconds) + float(f"0.{fraction}"))
    if len(times) < 2 or any(later <= earlier for earlier, later in pairwise(times)):
        return None
    return [time - times[0] for time in times]


def is_image_pattern(text: str) -> bool:
    """Return whether a path is a folder with image files, or a pattern that matches some."""
    try:
        return bool(list_images(text))
    except CaptureError:
        return False

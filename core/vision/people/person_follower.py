"""One person, followed through the pictures of one camera, and others beside them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from ...geometry.arrays import Array, Image
from .body_network import BodyNetwork, Crop, FoundPerson


@dataclass(frozen=True)
class FollowSettings:
    """Settings of `PersonFollower`."""

    least_score: float = 0.5  # score below which a crop shows nobody
    sides: tuple[float, ...] = (1.0, 0.6, 0.4, 1.6)  # sides of searched crops, in units of the picture's shorter side
    step: float = 0.4  # distance between searched crops, in units of their side
    tries: int = 40  # crops that are searched in each picture
    refinements: int = 3  # largest number of times that a crop is moved to the person just found in it
    kept: float = 0.6  # share of the last crop that is kept, because points tremble with their crop
    beside: float = 0.1  # margin round a person in which nobody else is looked for, in units of the person's extent
    sure: float = 0.9  # least score of somebody else: furniture has up to 0.83, a hanging cloth had 0.96 in one picture
    held: int = 5  # number of pictures in which a lost person is looked for in the same place before the search


_S = FollowSettings()


class PersonFollower:
    """Finds a person, and follows the same person from picture to picture.

    Args:
        network: Network that finds the points.
        tries: Number of crops that are searched in each picture until somebody is found; the search goes on in the
            next picture.
    """

    def __init__(self, network: BodyNetwork, tries: int = _S.tries) -> None:
        self.network, self._tries = network, tries
        self._crop: Crop | None = None
        self._lost = 0
        self._search: Iterator[Crop] | None = None

    def step(self, image: Image) -> FoundPerson | None:
        """Return the person in the next picture; None if nobody is found."""
        if self._crop is None:
            return self._start(image)
        found = self.network.find(image, self._crop)
        if found.score < _S.least_score:
            self._lost += 1
            if self._lost > _S.held:
                self._crop = None
            return None
        self._lost, self._crop = 0, _between(found.crop, self._crop, _S.kept)
        return found

    def _start(self, image: Image) -> FoundPerson | None:
        self._search = self._search or _crops(image)
        tried = 0
        for crop in islice(self._search, self._tries):
            tried += 1
            if person := _refined(self.network, image, crop):
                self._crop, self._lost, self._search = person.crop, 0, None
                return person
        if tried < self._tries:
            self._search = None
        return None


def find_other(network: BodyNetwork, image: Image, pixels: Array) -> FoundPerson | None:
    """Return somebody else in a picture than the person who has these points (K, 2); None if nobody is found."""
    margin = _S.beside * float(np.ptp(pixels, axis=0).max())
    low, high = pixels.min(axis=0) - margin, pixels.max(axis=0) + margin
    (left, top), (right, bottom) = (
        np.clip(corner, 0, image.shape[1::-1]).astype(int).tolist() for corner in (low, high)
    )
    hidden = image.copy()
    hidden[top:bottom, left:right] = np.median(image, axis=(0, 1))
    found = [person for crop in _crops(hidden) if (person := _refined(network, hidden, crop))]
    surest = max(found, key=lambda person: person.score, default=None)
    if surest is None or surest.score < _S.sure:
        return None
    middle = np.median(surest.pixels, axis=0)
    return surest if np.any((middle < low) | (middle > high)) else None


def _refined(network: BodyNetwork, image: Image, crop: Crop) -> FoundPerson | None:
    """Return the person in a crop, found again in crops of their own; None if nobody is there."""
    found = None
    for _ in range(1 + _S.refinements):
        found = network.find(image, crop)
        if found.score < _S.least_score:
            return None
        crop = found.crop
    return found


def _crops(image: Image) -> Iterator[Crop]:
    """Yield crops of many places and sizes; those of each size from the middle of the picture outwards."""
    height, width = image.shape[:2]
    for share in _S.sides:
        side = share * min(height, width)
        places = [(x, y) for x in _places(width, side) for y in _places(height, side)]
        for x, y in sorted(places, key=lambda at: (at[0] - width / 2) ** 2 + (at[1] - height / 2) ** 2):
            yield Crop(x, y, side)


def _places(length: float, side: float) -> list[float]:
    """Return the centres of crops along one side of a picture."""
    apart = _S.step * side
    count = max(1, math.ceil((length - 0.5 * side) / apart))
    return [0.5 * (length - 1) + apart * (number - 0.5 * (count - 1)) for number in range(count)]


def _between(new: Crop, old: Crop, kept: float) -> Crop:
    """Return a crop between two, with this share of the old one."""
    turn = math.remainder(new.turn_rad - old.turn_rad, 2.0 * math.pi)
    x, y, side = (kept * before + (1.0 - kept) * after for before, after in zip(old[:3], new[:3], strict=True))
    return Crop(x, y, side, old.turn_rad + (1.0 - kept) * turn)

"""Marker frames with some of their points, rays or blobs removed."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..geometry.arrays import IntArray, Mask
from .marker_frame import MarkerFrame


def without_points(frame: MarkerFrame, taken: Mask) -> MarkerFrame:
    """Return the frame without the points in a mask (N,); their blobs are kept."""
    return _without(frame, taken, ("points_m", "covariances_m2", "labels", "point_blobs"))


def without_rays(frame: MarkerFrame, taken: Mask) -> MarkerFrame:
    """Return the frame without the rays in a mask (R,); their blobs are kept."""
    return _without(frame, taken, ("single_cameras", "single_blobs", "single_points", "single_labels"))


def _without(frame: MarkerFrame, taken: Mask, fields: tuple[str, ...]) -> MarkerFrame:
    rows: dict[str, Any] = {name: getattr(frame, name)[~taken] for name in fields}
    return replace(frame, **rows)


def without_blobs(frame: MarkerFrame, taken: Sequence[IntArray]) -> MarkerFrame:
    """Return the frame without some blobs, and without the points and rays made from them.

    Args:
        taken: Indices of the blobs to remove, for each camera.
    """
    if not any(len(rows) for rows in taken):
        return frame
    kept = [np.ones(len(blobs), dtype=bool) for blobs in frame.blobs]
    for rows, left in zip(taken, kept, strict=True):
        left[rows] = False
    # new index of each blob, -1 for removed blobs; the additional last entry maps -1 to itself
    places = [np.append(np.where(left, np.cumsum(left) - 1, -1), -1) for left in kept]
    point_blobs = np.stack([place[column] for place, column in zip(places, frame.point_blobs.T, strict=True)], axis=1)
    lost = np.any((frame.point_blobs >= 0) & (point_blobs < 0), axis=1)
    single_blobs = np.array(
        [places[camera][blob] for camera, blob in zip(frame.single_cameras, frame.single_blobs, strict=True)],
        dtype=np.int64,
    )
    gone = (single_blobs < 0) & (frame.single_blobs >= 0)
    blobs = tuple(rows[left] for rows, left in zip(frame.blobs, kept, strict=True))
    renumbered = replace(
        frame,
        blobs=blobs,
        detected=blobs,
        normalised=tuple(rows[left] for rows, left in zip(frame.normalised, kept, strict=bool(frame.normalised))),
        point_blobs=point_blobs,
        single_blobs=single_blobs,
    )
    return without_rays(without_points(renumbered, lost), gone)

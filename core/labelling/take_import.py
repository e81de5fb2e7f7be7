"""Import of marker takes: conversion to y up and to the names of the marker set."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import TakeError
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..geometry.camera import CameraRig
from ..geometry.rigid_transform import principal_axes, transform
from ..markers.floor_from_feet import floor_points
from ..markers.label_matching import join_names, match_labels
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from ..markers.take_frames import check_torso, is_unnamed
from .human_size import check_human_size
from .trajectory_naming import misfit_of_names_m, name_trajectories
from .up_axis import TURNS, axis_up

UPS = ("auto", "feet", "y", "z")

_UP = np.array([0.0, 1.0, 0.0])


def import_take(take: MarkerTake, marker_set: MarkerSet, up: str | None) -> MarkerTake:
    """Return a take with y up and its markers under the names of the marker set.

    Labels are matched by `match_labels`. If they do not include the torso markers and the take has as many markers as
    the set, the markers are named by their positions on a standing body. A take of one camera is returned unchanged: it
    is labelled when it is solved, and its calibration defines the world.

    Args:
        marker_set: Marker set with usual offsets.
        up: One of `UPS`: the axis of the file that points up; "auto" for the axis along which the performer stands or
            sits for most of the take (`axis_up`), or for y if the take is known to be upright; "feet" for the floor
            under the feet, which becomes y = 0; None to keep the file's axes.

    Raises:
        TakeError: The markers are not those of the set, the body is not of human size, or too few markers are visible
            at once to find the vertical.
        MarkerSetError: The set has no usual offsets, but they are needed to find the floor or the names.
    """
    if is_unnamed(take):
        return take
    match = match_labels(take.names, marker_set)
    if up is None or (up == "auto" and take.is_upright):
        named = match.rename(take)
        check_human_size(named, marker_set)
        return named
    if not match.has_torso:
        if match.label_of and len(take.names) != len(marker_set):
            check_torso(match.rename(take), marker_set)
        named = _by_place(take, marker_set, [up] if up in TURNS else list(TURNS))
    else:
        named = match.rename(take)
        named = turned(named, TURNS[up if up in TURNS else axis_up(named, marker_set)])
    check_human_size(named, marker_set)
    named = replace(named, is_upright=True)
    return _on_floor(named, marker_set.subset(named.names)) if up == "feet" else named


def _by_place(take: MarkerTake, marker_set: MarkerSet, axes: Sequence[str]) -> MarkerTake:
    """Return the take with y up and with markers named by their positions."""
    if len(take.names) != len(marker_set):
        raise TakeError(
            f"its markers are called {join_names(take.names)}, but those of the set {marker_set.name} "
            f"are called {join_names(marker_set.names)}",
            where=take.name,
            advice="choose the marker set that was worn, or give one of your own (TOML) with these names",
        )
    problem: TakeError | None = None
    found: list[MarkerTake] = []
    for axis in axes:
        try:
            named = name_trajectories(turned(take, TURNS[axis]), marker_set)
        except TakeError as error:
            problem = problem or error
            continue
        # markers can also be named along a wrong axis, but then the body lies or is upside down
        if len(axes) == 1 or axis_up(named, marker_set) == "y":
            found.append(named)
    if found:  # along a wrong axis, some markers get the names of others
        return min(found, key=lambda named: misfit_of_names_m(named, marker_set))
    advice = "choose the marker set that was worn, or give one of your own (TOML) with the file's names"
    raise TakeError(
        problem.what if problem else "along no axis of the take is the body upright", where=take.name, advice=advice
    )


def _on_floor(take: MarkerTake, marker_set: MarkerSet) -> MarkerTake:
    """Return the take with the floor under the feet at y = 0 and its heading unchanged."""
    points = floor_points(take, marker_set)
    middle, _, axes = principal_axes(points)
    normal = axes[2] if axes[2, 1] > 0.0 else -axes[2]
    turn = rot.to_matrix(rot.between(normal, _UP))
    return turned(take, turn, np.array([0.0, -float((turn @ middle)[1]), 0.0]))


def turned(take: MarkerTake, turn: Array, shift_m: Array | None = None) -> MarkerTake:
    """Return a take, with its cameras, in a moved world (p becomes turn p + shift)."""
    shift_m = np.zeros(3) if shift_m is None else shift_m
    single = take.single
    if single is not None:
        cameras = []
        for camera in single.rig.cameras:
            rotation = camera.rotation @ turn.T
            cameras.append(replace(camera, rotation=rotation, translation_m=camera.translation_m - rotation @ shift_m))
        single = replace(single, rig=CameraRig(tuple(cameras), single.rig.metadata))
    return replace(take, positions_m=transform(turn, shift_m, take.positions_m), single=single)

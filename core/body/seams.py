"""A motion that continues another.

It is turned and shifted along the floor so that it begins where the other ends. What still differs at the seam, poses
and speeds, is taken over by an offset that fades out (inertialisation: Bollo, "High-Performance Animation in Gears of
War 4", 2016). Feet that stand on both sides of the seam stay where they stand until their next step, or take a small
step of their own.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import SettingsError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, Mask, runs
from .motion import Motion
from .moved_feet import floor_height_m, smooth_step, with_moved_feet
from .standing_feet import balls_m, planted_feet

_FLOOR_AXES = np.array([1.0, 0.0, 1.0])


@dataclass(frozen=True)
class SeamSettings:
    """Feet at a seam."""

    stays_m: float = 0.12  # largest distance by which a foot may stand beside its place until its next step
    lift: float = 0.25  # height of a step made for the seam, as a fraction of its length
    least_lift_m: float = 0.02
    most_lift_m: float = 0.08
    soon_s: float = 0.35  # a foot whose next step comes earlier than this stays
    lands: float = 0.6  # part of the blend in which a raised foot comes down at the earliest


_SETTINGS = SeamSettings()


def continued(before: Motion, after: Motion, blend_s: float) -> Motion:
    """Return the second motion placed and blended so that it continues the first.

    Args:
        before: Last frames of the first motion, at least two, on the same skeleton and at the same rate; the last one
            is at the time of the second motion's first frame.
        blend_s: Time after which the pose is the second motion's own.

    Raises:
        SettingsError: There are fewer than two frames on one side.
    """
    if before.frames < 2 or after.frames < 2:
        raise SettingsError("a motion of one frame cannot be continued", advice="choose longer takes")
    placed = _placed_after(before, after)
    frames = max(1, min(round(blend_s * after.fps), after.frames - 1))
    blended = _inertialised(before, placed, frames)
    return with_moved_feet(blended, _feet_targets(before, placed, blended, frames) - balls_m(blended))


def heading(rotations: Array) -> Array:
    """Return the headings (...) of world rotations (..., 4), radians about the vertical from z to x."""
    forward = rot.rotate(rotations, np.array([0.0, 0.0, 1.0]))
    return np.arctan2(forward[..., 0], forward[..., 2])


def about_vertical(angles: Array) -> Array:
    """Return rotations (..., 4) about the vertical."""
    return rot.from_rotation_vector(np.asarray(angles)[..., None] * [0.0, 1.0, 0.0])


def _placed_after(before: Motion, after: Motion) -> Motion:
    """Return the second motion with the place and heading of the first one's end."""
    turn = about_vertical(heading(before.rotations[-1, 0]) - heading(after.rotations[0, 0]))
    start_m, end_m = after.root_positions_m[0], before.root_positions_m[-1]
    rotations = after.rotations.copy()
    rotations[:, 0] = rot.multiply(turn, rotations[:, 0])
    roots_m = rot.rotate(turn, after.root_positions_m - start_m * _FLOOR_AXES) + end_m * _FLOOR_AXES
    return replace(after, rotations=rotations, root_positions_m=roots_m)


def _inertialised(before: Motion, after: Motion, frames: int) -> Motion:
    """Return the second motion with an offset that fades from the seam's differences in poses and speeds to zero."""
    offset, speed = _fading(after.frames, frames)
    ends, starts = before.root_positions_m[-2:], after.root_positions_m[:2]
    roots_m = after.root_positions_m + offset[:, None] * (ends[1] - starts[0])
    roots_m += speed[:, None] * ((ends[1] - ends[0]) - (starts[1] - starts[0]))
    last, first = before.rotations[-2:], after.rotations[:2]
    apart = _vectors_between(first[0], last[1])
    faster = _vectors_between(last[0], last[1]) - _vectors_between(first[0], first[1])
    vectors = offset[:, None, None] * apart + speed[:, None, None] * faster
    rotations = rot.normalize(rot.multiply(rot.from_rotation_vector(vectors), after.rotations))
    return replace(after, rotations=rotations, root_positions_m=roots_m)


def _fading(count: int, frames: int) -> tuple[Array, Array]:
    """Return the factors (count,) of an offset and of a speed per frame: quintics that end at rest."""
    s = np.minimum(np.arange(count) / frames, 1.0)
    return 1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s * s), frames * s * (1.0 - s) ** 3 * (1.0 + 3.0 * s)


def _vectors_between(start: Array, end: Array) -> Array:
    return rot.to_rotation_vector(rot.multiply(end, rot.conjugate(start)))


def _feet_targets(before: Motion, after: Motion, blended: Motion, frames: int) -> Array:
    """Return the places (F, 2, 3) of the balls of both feet."""
    own, mixed = balls_m(after), balls_m(blended)
    planted = planted_feet(after, floor_height_m(after))
    stood = planted_feet(before, floor_height_m(before))[-1]
    steps = [foot for foot in range(2) if stood[foot] and _moves(own, mixed, planted, foot, after.fps)]
    found = mixed.copy()
    for foot in range(2):
        if foot in steps:
            share = steps.index(foot), len(steps)
            found[:, foot] = own[:, foot] + _own_step(mixed[0, foot] - own[0, foot], frames, len(own), share)
        elif stood[foot] and planted[0, foot]:
            found[:, foot] = own[:, foot] + _until_next_step(mixed[:, foot] - own[:, foot], planted[:, foot], frames)
        else:
            lands = int(np.argmax(planted[:, foot])) if planted[:, foot].any() else frames
            start = min(max(lands, round(_SETTINGS.lands * frames), 1), frames)
            fade = 1.0 - smooth_step(np.arange(len(own)) / start)
            found[:, foot] = own[:, foot] + fade[:, None] * (mixed[:, foot] - own[:, foot])
    return found


def _moves(own: Array, mixed: Array, planted: Mask, foot: int, fps: float) -> bool:
    """Return whether a foot that stands on both sides of the seam takes a step of its own."""
    if not planted[0, foot]:
        return False
    away_m = float(np.linalg.norm((mixed[0, foot] - own[0, foot]) * _FLOOR_AXES))
    stands = runs(planted[:, foot])[0][1]
    return away_m > _SETTINGS.stays_m and stands > _SETTINGS.soon_s * fps


def _own_step(away_m: Array, frames: int, count: int, share: tuple[int, int]) -> Array:
    """Return the offsets (count, 3) of a foot that takes a step to its place; two feet step one after the other."""
    number, of = share
    at = np.clip((np.arange(count) / frames * of - number), 0.0, 1.0)
    length_m = float(np.linalg.norm(away_m * _FLOOR_AXES))
    lift_m = np.clip(_SETTINGS.lift * length_m, _SETTINGS.least_lift_m, _SETTINGS.most_lift_m)
    lifted = lift_m * np.sin(np.pi * at) ** 2
    return (1.0 - smooth_step(at))[:, None] * away_m + lifted[:, None] * [0.0, 1.0, 0.0]


def _until_next_step(away_m: Array, planted: Mask, frames: int) -> Array:
    """Return the offsets (F, 3) of a foot that stays where it stands and is moved to its place by its next step."""
    count = np.arange(len(planted))
    stands = runs(planted)
    stop = stands[0][1]
    landing = stands[1][0] if len(stands) > 1 else stop + frames
    held = away_m[0] * _FLOOR_AXES
    along = (1.0 - smooth_step((count - stop + 1) / max(landing - stop, 1)))[:, None] * held
    return along + away_m * [0.0, 1.0, 0.0]

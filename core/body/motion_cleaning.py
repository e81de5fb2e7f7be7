"""Defects of recorded motion: detection, repair and removal.

A capture system that confuses markers, or a solver that finds the other of two solutions, makes a joint jump between
two frames and, mostly, back some frames later. Unlike in a fast motion, the frames before and
after show nothing of it: a joint that stands still, turns by e between two frames and stands still again has to speed
up for half of the time between them and to brake for the other half, which takes an acceleration of 4 e / dt^2. So the
step of every joint is compared with the steps beside it, and is a jump where it differs from both by more than the
strongest accelerations of athletes allow (`_ANGULAR_ACCELERATION`, `_ROOT_ACCELERATION`), or where the speed itself is
above theirs. At high rates these limits come below the noise of solved recordings, so there are least steps as well.

Treatment of each defect:

- A root jump leaves the poses on both sides as they are, but speed and place are wrong at the jump: the clip is cut
  there, and goes on as another clip.
- A limb pop (all joints but `_ENDS`) is not repaired: when a marker is confused, the other joints of the limb are
  wrong as well. Frames between two jumps that lie at most `_LONGEST_POP_S` apart are cut out, and the clip goes on
  as another; between jumps that lie further apart nobody knows which side is right, so both are kept, as clips of
  their own.
- Hands, fingers, thumbs and toes (`_ENDS`) flip far more often, by half a turn, without anything else being wrong:
  for as short their rotation is interpolated from the frames beside. Longer ones are kept: a pose with a turned thumb
  is worth more than none.
- A T pose put before the motion as first frame is cut off.
- Angles that jump while the rotation does not (the two Euler forms of one rotation) are no defect of the motion: they
  are kept, and named only because other programs stumble over them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array, Mask, runs
from .motion import Motion, sliced
from .skeleton import forward_kinematics
from .standard_skeleton import JOINT_NAMES

Apart = Callable[[int, int], float]  # of two frames

# Shoulders and elbows of pitchers reach 130 rad/s and some 5,000 rad/s^2; nothing in everyday motion is near.
_ANGULAR_SPEED = 130.0
_ANGULAR_ACCELERATION = 5000.0
# Above what noise does: a marker that is 3 to 5 cm off turns a bone by so much, the more the shorter it is.
_LEAST_STEP_DEG = {"foot": 45.0, "wrist": 60.0, "hand": 60.0, "fingers": 60.0, "thumb": 60.0, "toes": 60.0}
_LEAST_LIMB_STEP_DEG = 30.0
# The fastest sprinters run 12.5 m/s; landings from jumps load the pelvis with 10 to 20 g.
_ROOT_SPEED = 13.0
_ROOT_ACCELERATION = 500.0
_LEAST_ROOT_STEP_M = 0.05
_LONGEST_POP_S = 0.25
_SETTLED = 0.25  # of a jump: when a joint is as near to where it was, it is back

_END_NAMES = ("wrist", "hand", "fingers", "thumb", "toes")
_ENDS = np.array([name[1:] in _END_NAMES for name in JOINT_NAMES])
_LEAST_STEPS = np.radians([_LEAST_STEP_DEG.get(name[1:], _LEAST_LIMB_STEP_DEG) for name in JOINT_NAMES])

_T_STEP = np.radians(25.0)  # by which both arms leave an added T pose at once
_STRAIGHT = np.radians(20.0)
_RAISED = np.radians(30.0)  # upper arms from hanging, in a T or A pose


@dataclass(frozen=True)
class Defect:
    """One defect of a file.

    Args:
        kind: its name ("limb pop of lfoot").
        first, last: frames of the file, counted from 1; 0 when it is not about frames.
        done: its treatment ("kept", "cut out", ...).
    """

    kind: str
    first: int
    last: int
    done: str


@dataclass(frozen=True)
class CleanedMotion:
    """Unbroken parts of a motion with their first frames, and its defects."""

    parts: tuple[tuple[int, Motion], ...]
    defects: tuple[Defect, ...]


def clean_motion(motion: Motion, angle_jumps: Mask) -> CleanedMotion:
    """Return the sound parts of a motion of the standard skeleton's joints.

    Args:
        motion: at the rate it was recorded with.
        angle_jumps: (F,) true where an angle in the file is far from that of the frame before.
    """
    defects: list[Defect] = []
    start = 0
    if _starts_with_added_pose(motion):
        defects.append(Defect("T pose added as first frame", 1, 1, "cut off"))
        start = 1
    jumps = _joint_jumps(motion)
    moved = _root_jumps(motion)
    jumps[: start + 1] = False
    moved[: start + 1] = False
    turned = angle_jumps & ~np.any(jumps, axis=1)
    turned[: start + 1] = False
    if np.any(turned):
        at = np.flatnonzero(turned)
        kind = f"Euler angles flip {len(at)} times, the rotation does not"
        defects.append(Defect(kind, int(at[0]) + 1, int(at[-1]) + 1, "kept"))
    motion = _ends_repaired(motion, jumps, start, defects)
    parts = _sound_parts(motion, jumps, moved, start, defects)
    return CleanedMotion(tuple(parts), tuple(sorted(defects, key=lambda defect: defect.first)))


def _isolated(steps: Array) -> Array:
    """Return (F - 1, ...) how far each step differs from its more similar neighbour.

    The first and the last step have only one beside them; as that may be the jump, the one after it counts as well.
    """
    before = np.roll(steps, 1, axis=0)
    after = np.roll(steps, -1, axis=0)
    before[0], after[-1] = steps[min(2, len(steps) - 1)], steps[max(len(steps) - 3, 0)]
    return np.minimum(rot.lengths(steps - before), rot.lengths(steps - after))


def _joint_jumps(motion: Motion) -> Mask:
    """Return (F, J) true at the first frame after a jump of a joint's rotation."""
    # twice the chord between unit quaternions: the angle of the rotation between them, but for large ones
    steps = 2.0 * np.diff(rot.continuous(motion.rotations), axis=0)
    needed = _ANGULAR_ACCELERATION / (4.0 * motion.fps**2)
    limits = np.maximum(needed, _LEAST_STEPS)
    return _jumps(steps, limits, np.maximum(limits, _ANGULAR_SPEED / motion.fps))


def _root_jumps(motion: Motion) -> Mask:
    """Return (F,) true at the first frame after a jump of the root."""
    steps = np.diff(motion.root_positions_m, axis=0)
    limit = max(_ROOT_ACCELERATION / (4.0 * motion.fps**2), _LEAST_ROOT_STEP_M)
    return _jumps(steps[:, None], np.array([limit]), np.array([max(limit, _ROOT_SPEED / motion.fps)]))[:, 0]


def _jumps(steps: Array, limits: Array, fastest: Array) -> Mask:
    """Return (F, J) whether the step (F - 1, J, ...) to a frame is odd or too fast.

    Args:
        limits: (J,) by how much an odd step differs from those beside it.
        fastest: (J,) steps that are too fast, limits at least.
    """
    jumps = np.zeros((len(steps) + 1, steps.shape[1]), dtype=np.bool_)
    if len(steps) > 1:
        lengths = rot.lengths(steps)
        # steps differ by more than a limit only where one of them is longer than half of it
        near = np.flatnonzero(np.max(lengths, axis=0) > 0.5 * limits)
        jumps[1:, near] = (_isolated(steps[:, near]) > limits[near]) | (lengths[:, near] > fastest[near])
    return jumps


def _pops(jumps: Mask, apart: Apart, start: int, longest: int) -> tuple[Mask, list[int]]:
    """Return (F,) true in pops, from a jump to the one back, and the lone jumps.

    A pop lasts at most `longest` frames, and shorter than what goes before or comes after; the frame after it is nearer
    to the one before it than either is to the pop. What leads back may take some frames more.

    Args:
        jumps: (F,) true at the first frame after a jump.
        apart: how far two frames are from each other.
    """
    popped = np.zeros(len(jumps), dtype=np.bool_)
    lone: list[int] = []
    places = [int(at) for at in np.flatnonzero(jumps)]
    sound_from = start
    while places:
        at = places.pop(0)
        ends = [*places[1:], len(jumps)]  # of the pieces that the later jumps begin
        back = next(
            (
                later
                for later, end in zip(places, ends, strict=False)
                if later - at <= min(longest, max(at - sound_from, end - later))
                and apart(at - 1, later) < min(apart(at - 1, at), apart(later - 1, later))
            ),
            None,
        )
        if back is None:
            lone.append(at)
            sound_from = at
            continue
        settled = _SETTLED * apart(at - 1, at)
        while back + 1 < min(len(jumps), at + longest) and settled < apart(at - 1, back) > apart(at - 1, back + 1):
            back += 1
        popped[at:back] = True
        places = [later for later in places if later > back]
        sound_from = back
    return popped, lone


def _with_short_pieces(popped: Mask, lone: Sequence[int], start: int, longest: int) -> Mask:
    """Return the pops and the short parts between lone jumps, or one and an end."""
    result = popped.copy()
    edges = [start, *lone, len(popped)]
    for first, stop in pairwise(edges):
        if lone and stop - first <= longest:
            result[first:stop] = True
    return result


def _turned(motion: Motion, joint: int) -> Apart:
    def apart(i: int, j: int) -> float:
        return float(rot.angle_between(motion.rotations[i, joint], motion.rotations[j, joint]))

    return apart


def _ends_repaired(motion: Motion, jumps: Mask, start: int, defects: list[Defect]) -> Motion:
    """Return the motion with short flips of hands, fingers and toes bridged."""
    flipping = np.flatnonzero(_ENDS & np.any(jumps, axis=0))
    if len(flipping) == 0:
        return motion
    longest = int(_LONGEST_POP_S * motion.fps)
    rotations = motion.rotations.copy()
    for joint in flipping:
        name = JOINT_NAMES[joint]
        popped, lone = _pops(jumps[:, joint], _turned(motion, joint), start, longest)
        popped = _with_short_pieces(popped, lone, start, longest)
        if np.all(popped[start:]):
            defects.append(Defect(f"flip of {name} again and again", start + 1, motion.frames, "kept"))
            continue
        for first, stop in runs(popped):
            rotations[first:stop, joint] = _bridge(motion.rotations[:, joint], first, stop, start)
            defects.append(Defect(f"flip of {name}", first + 1, stop, "rotation interpolated"))
        kept = [at for at in lone if not (popped[at] or popped[at - 1])]
        if kept:
            kind = f"flip of {name}, too long to interpolate"
            defects.append(Defect(kind, kept[0] + 1, kept[-1] + 1, "kept"))
    return replace(motion, rotations=rotations)


def _bridge(rotations: Array, first: int, stop: int, start: int) -> Array:
    """Return the rotations (stop - first, 4) that bridge a run between its neighbours."""
    if first == start:
        return np.tile(rotations[stop], (stop - first, 1))
    if stop == len(rotations):
        return np.tile(rotations[first - 1], (stop - first, 1))
    share = np.arange(1, stop - first + 1) / (stop - first + 1)
    return rot.slerp(rotations[first - 1], rotations[stop], share)


def _sound_parts(
    motion: Motion, jumps: Mask, moved: Mask, start: int, defects: list[Defect]
) -> list[tuple[int, Motion]]:
    """Return the parts between jumps of root and limbs, without the frames of pops."""
    limbs = jumps & ~_ENDS
    longest = int(_LONGEST_POP_S * motion.fps)
    positions = motion.root_positions_m
    kinds: list[tuple[Mask, Apart]] = [(moved, lambda i, j: float(np.linalg.norm(positions[j] - positions[i])))]
    kinds += [(limbs[:, joint], _turned(motion, joint)) for joint in np.flatnonzero(np.any(limbs, axis=0))]
    out = np.zeros(motion.frames, dtype=np.bool_)
    single: set[int] = set()
    for places, apart in kinds:
        popped, lone = _pops(places, apart, start, longest)
        out |= popped
        single.update(lone)
    out = _with_short_pieces(out, sorted(single), start, longest)
    at_jump = moved | np.any(limbs, axis=1)
    for first, stop in runs(out):
        edges = [at for at in range(first, min(stop + 1, motion.frames)) if at_jump[at]]
        defects.append(Defect(_kind(limbs, moved, edges), first + 1, stop, "cut out"))
    cuts = [at for at in sorted(single) if not (out[at] or out[at - 1])]
    defects += [Defect(_kind(limbs, moved, [at]), at + 1, at + 1, "cut, goes on as another clip") for at in cuts]
    out[:start] = True
    bounds = sorted({bound for pair in runs(~out) for bound in pair} | set(cuts))
    return [(first, sliced(motion, first, stop)) for first, stop in pairwise(bounds) if not np.any(out[first:stop])]


def _kind(limbs: Mask, moved: Mask, edges: list[int]) -> str:
    if np.any(moved[edges]) or np.any(limbs[edges, 0]):
        return "root jump"
    names = [JOINT_NAMES[joint] for joint in np.flatnonzero(np.any(limbs[edges], axis=0))]
    return "limb pop of " + ", ".join(names)


def _starts_with_added_pose(motion: Motion) -> bool:
    """Tell whether the first frame is a T or A pose left by both arms at once.

    Arms that stand cannot turn by 25 degrees until the next frame and stand again, at 60 frames per second or more.
    At 30 they could, but nobody moves so who holds a T pose.
    """
    if motion.frames < 3:
        return False
    steps = rot.angle_between(motion.rotations[:2], motion.rotations[1:3])
    arms = [JOINT_NAMES.index(side + "humerus") for side in "lr"]
    if np.any(steps[0, arms] < _T_STEP) or np.any(steps[1, arms] > 0.5 * steps[0, arms]):
        return False
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations[:1], motion.root_positions_m[:1])
    place = {name: positions[0, joint] for joint, name in enumerate(JOINT_NAMES)}
    down = place["lowerback"] - place["thorax"]
    angles = []
    for side in "lr":
        upper, lower = (place[side + b] - place[side + a] for a, b in (("humerus", "radius"), ("radius", "wrist")))
        thigh, shank = (place[side + b] - place[side + a] for a, b in (("femur", "tibia"), ("tibia", "foot")))
        if _angle(upper, lower) > _STRAIGHT or _angle(thigh, shank) > _STRAIGHT:
            return False
        angles.append(_angle(upper, down))
    return min(angles) > _RAISED and abs(angles[0] - angles[1]) < _STRAIGHT


def _angle(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))

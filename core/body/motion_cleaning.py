"""Defects of recorded motion: detection, repair and removal.

A capture system that confuses markers, or a solver that finds the wrong one of two solutions, makes a joint jump
between two frames and usually back some frames later. In fast motion the joint also moves in the neighbouring frames;
at a defect it does not. A joint that is still, turns by an angle e within one frame and is still again needs an
acceleration of 4 e / dt^2. So the step of each joint is compared with the steps next to it. It is a jump if it differs
from both by more than the accelerations that athletes reach, or is faster than athletes (`CleaningSettings`). At high
frame rates these limits fall below the noise of solved recordings, so a jump must also exceed a minimum step.

Treatment of each defect:

- Root jump: the poses on both sides are right, but speed and position are wrong at the jump. The clip is cut in two
  there.
- Limb pop (all joints but `_ENDS`): the other joints of the limb are wrong as well, so the pop is not repaired. The
  frames between two jumps at most `longest_pop_s` apart are cut out, and what follows becomes another clip. If the
  jumps are further apart, it is unknown which side is right: both are kept, as separate clips.
- Flip of hands, fingers, thumbs or toes (`_ENDS`): common, by half a turn, without errors of other joints. Short flips
  are interpolated. Longer ones are kept: a pose with a turned thumb is better than none.
- T pose added as first frame: cut off.
- Angles that jump while the rotation does not (the two Euler forms of one rotation): kept, as the motion is right. They
  are only reported, because they cause problems in other programs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..errors import counted
from ..geometry import rotations as rot
from ..geometry.arrays import Array, Mask, runs
from .motion import Motion, sliced
from .skeleton import forward_kinematics
from .standard_skeleton import JOINT_NAMES

Apart = Callable[[int, int], float]  # function that returns the distance between two frames


@dataclass(frozen=True)
class CleaningSettings:
    """Limits of human motion and of defects.

    Shoulders and elbows of pitchers reach 130 rad/s and 5,000 rad/s^2. The fastest sprinters run 12.5 m/s, and landings
    load the pelvis with 10 to 20 g. The minimum steps lie above the noise: a marker that is 3 to 5 cm off turns a bone
    by about as much, and short bones by more.
    """

    turn_rad_s: float = 130.0  # highest angular speed of a joint
    turn_rad_s2: float = 5000.0  # largest angular acceleration of a joint
    limb_step_deg: float = 30.0  # smallest jump of a joint between two frames
    foot_step_deg: float = 45.0  # smallest jump of the feet
    end_step_deg: float = 60.0  # smallest jump of hands, fingers, thumbs and toes
    root_m_s: float = 13.0  # highest speed of the root
    root_m_s2: float = 500.0  # largest acceleration of the root
    root_step_m: float = 0.05  # smallest jump of the root between two frames
    longest_pop_s: float = 0.25  # longest pop that is cut out or interpolated
    settled: float = 0.25  # largest distance, as a fraction of the jump, of a joint that is back at its earlier pose
    t_step_deg: float = 25.0  # smallest rotation of both arms between an added T pose and the first real frame
    straight_deg: float = 20.0  # largest bend of a straight limb
    raised_deg: float = 30.0  # smallest angle of the upper arms from straight down in a T or A pose


_SETTINGS = CleaningSettings()
_END_NAMES = ("wrist", "hand", "fingers", "thumb", "toes")
_ENDS = np.array([name[1:] in _END_NAMES for name in JOINT_NAMES])
_LEAST_STEPS = np.radians(
    [
        _SETTINGS.end_step_deg if is_end else _SETTINGS.foot_step_deg if "foot" in name else _SETTINGS.limb_step_deg
        for name, is_end in zip(JOINT_NAMES, _ENDS, strict=True)
    ]
)


@dataclass(frozen=True)
class Defect:
    """One defect of a file.

    Args:
        kind: Name of the defect ("limb pop of lfoot").
        first, last: First and last frame in the file, counted from 1; 0 if the defect does not concern particular
            frames.
        done: Treatment ("kept", "cut out", ...).
    """

    kind: str
    first: int
    last: int
    done: str


@dataclass(frozen=True)
class CleanedMotion:
    """Sound parts of a motion, each with its first frame, and the motion's defects."""

    parts: tuple[tuple[int, Motion], ...]
    defects: tuple[Defect, ...]


def clean_motion(motion: Motion, angle_jumps: Mask) -> CleanedMotion:
    """Return the sound parts of a motion of the standard skeleton's joints.

    Args:
        motion: Motion at its recorded rate.
        angle_jumps: Frames (F,) with an angle in the file far from that of the previous frame.
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
        kind = f"Euler angles flip {counted(len(at), 'time')}, but the rotation does not"
        defects.append(Defect(kind, int(at[0]) + 1, int(at[-1]) + 1, "kept"))
    motion = _ends_repaired(motion, jumps, start, defects)
    parts = _sound_parts(motion, jumps, moved, start, defects)
    return CleanedMotion(tuple(parts), tuple(sorted(defects, key=lambda defect: defect.first)))


def _isolated(steps: Array) -> Array:
    """Return the difference (F - 1, J) of each step from the more similar of the two steps next to it.

    The first and last steps have only one neighbour, which may be the jump itself, so the next but one is compared,
    too.
    """
    before = np.roll(steps, 1, axis=0)
    after = np.roll(steps, -1, axis=0)
    before[0], after[-1] = steps[min(2, len(steps) - 1)], steps[max(len(steps) - 3, 0)]
    return np.minimum(rot.lengths(steps - before), rot.lengths(steps - after))


def _joint_jumps(motion: Motion) -> Mask:
    """Return a mask (F, J) of the frames at which a joint's rotation jumps from the previous frame."""
    # twice the chord between unit quaternions is about the angle between them
    steps = 2.0 * np.diff(rot.continuous(motion.rotations), axis=0)
    needed = _SETTINGS.turn_rad_s2 / (4.0 * motion.fps**2)
    limits = np.maximum(needed, _LEAST_STEPS)
    return _jumps(steps, limits, np.maximum(limits, _SETTINGS.turn_rad_s / motion.fps))


def _root_jumps(motion: Motion) -> Mask:
    """Return a mask (F,) of the frames at which the root jumps from the previous frame."""
    steps = np.diff(motion.root_positions_m, axis=0)
    limit = max(_SETTINGS.root_m_s2 / (4.0 * motion.fps**2), _SETTINGS.root_step_m)
    return _jumps(steps[:, None], np.array([limit]), np.array([max(limit, _SETTINGS.root_m_s / motion.fps)]))[:, 0]


def _jumps(steps: Array, limits: Array, fastest: Array) -> Mask:
    """Return a mask (F, J) of the frames whose step from the previous frame is a jump or too fast.

    Args:
        steps: Changes (F - 1, J, ...) from each frame to the next.
        limits: Smallest difference (J,) between a jump and the steps next to it.
        fastest: Longest possible steps (J,), not below the limits.
    """
    jumps = np.zeros((len(steps) + 1, steps.shape[1]), dtype=np.bool_)
    if len(steps) > 1:
        lengths = rot.lengths(steps)
        # two steps can differ by more than a limit only if one is longer than half the limit
        near = np.flatnonzero(np.max(lengths, axis=0) > 0.5 * limits)
        jumps[1:, near] = (_isolated(steps[:, near]) > limits[near]) | (lengths[:, near] > fastest[near])
    return jumps


def _pops(jumps: Mask, apart: Apart, start: int, longest: int) -> tuple[Mask, list[int]]:
    """Return a mask (F,) of the frames in pops, from a jump to the jump back, and the jumps without a jump back.

    A pop lasts at most `longest` frames, and not longer than the sound motion before it or after it. The frames around
    it are nearer to each other than to the pop. The jump back may be spread over several frames.

    Args:
        jumps: Mask (F,) of the frames at which there is a jump.
        apart: Function that returns the distance between two frames.
    """
    popped = np.zeros(len(jumps), dtype=np.bool_)
    lone: list[int] = []
    places = [int(at) for at in np.flatnonzero(jumps)]
    sound_from = start
    while places:
        at = places.pop(0)
        ends = [*places[1:], len(jumps)]  # ends of the parts that begin at the later of these jumps
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
        settled = _SETTINGS.settled * apart(at - 1, at)
        while back + 1 < min(len(jumps), at + longest) and settled < apart(at - 1, back) > apart(at - 1, back + 1):
            back += 1
        popped[at:back] = True
        places = [later for later in places if later > back]
        sound_from = back
    return popped, lone


def _with_short_pieces(popped: Mask, lone: Sequence[int], start: int, longest: int) -> Mask:
    """Return the mask of pops, extended to short parts between unpaired jumps, or between one and the motion's ends."""
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
    """Return the motion with short flips of hands, fingers, thumbs and toes interpolated."""
    flipping = np.flatnonzero(_ENDS & np.any(jumps, axis=0))
    if len(flipping) == 0:
        return motion
    longest = int(_SETTINGS.longest_pop_s * motion.fps)
    rotations = motion.rotations.copy()
    for joint in flipping:
        name = JOINT_NAMES[joint]
        popped, lone = _pops(jumps[:, joint], _turned(motion, joint), start, longest)
        popped = _with_short_pieces(popped, lone, start, longest)
        if np.all(popped[start:]):
            defects.append(Defect(f"repeated flips of {name}", start + 1, motion.frames, "kept"))
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
    """Return rotations (stop - first, 4) for frames from `first` on, interpolated between those around them."""
    if first == start:
        return np.tile(rotations[stop], (stop - first, 1))
    if stop == len(rotations):
        return np.tile(rotations[first - 1], (stop - first, 1))
    share = np.arange(1, stop - first + 1) / (stop - first + 1)
    return rot.slerp(rotations[first - 1], rotations[stop], share)


def _sound_parts(
    motion: Motion, jumps: Mask, moved: Mask, start: int, defects: list[Defect]
) -> list[tuple[int, Motion]]:
    """Return the parts between jumps of root and limbs, without frames in pops, each with its first frame."""
    limbs = jumps & ~_ENDS
    longest = int(_SETTINGS.longest_pop_s * motion.fps)
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
    defects += [Defect(_kind(limbs, moved, [at]), at + 1, at + 1, "cut, the rest is another clip") for at in cuts]
    out[:start] = True
    bounds = sorted({bound for pair in runs(~out) for bound in pair} | set(cuts))
    return [(first, sliced(motion, first, stop)) for first, stop in pairwise(bounds) if not np.any(out[first:stop])]


def _kind(limbs: Mask, moved: Mask, edges: list[int]) -> str:
    if np.any(moved[edges]) or np.any(limbs[edges, 0]):
        return "root jump"
    names = [JOINT_NAMES[joint] for joint in np.flatnonzero(np.any(limbs[edges], axis=0))]
    return "limb pop of " + ", ".join(names)


def _starts_with_added_pose(motion: Motion) -> bool:
    """Return whether the first frame is a T or A pose that both arms leave within one frame.

    At 60 frames per second or more, arms cannot turn by 25 degrees between two frames and be still before and after.
    At 30 they could, but no one leaves a T pose like that.
    """
    if motion.frames < 3:
        return False
    steps = rot.angle_between(motion.rotations[:2], motion.rotations[1:3])
    arms = [JOINT_NAMES.index(side + "humerus") for side in "lr"]
    if np.any(steps[0, arms] < np.radians(_SETTINGS.t_step_deg)) or np.any(steps[1, arms] > 0.5 * steps[0, arms]):
        return False
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations[:1], motion.root_positions_m[:1])
    place = {name: positions[0, joint] for joint, name in enumerate(JOINT_NAMES)}
    down, straight = place["lowerback"] - place["thorax"], np.radians(_SETTINGS.straight_deg)
    angles = []
    for side in "lr":
        upper, lower = (place[side + b] - place[side + a] for a, b in (("humerus", "radius"), ("radius", "wrist")))
        thigh, shank = (place[side + b] - place[side + a] for a, b in (("femur", "tibia"), ("tibia", "foot")))
        if _angle(upper, lower) > straight or _angle(thigh, shank) > straight:
            return False
        angles.append(_angle(upper, down))
    return min(angles) > np.radians(_SETTINGS.raised_deg) and abs(angles[0] - angles[1]) < straight


def _angle(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))

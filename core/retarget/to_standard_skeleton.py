"""Conversion of motion on any skeleton to the standard skeleton.

Joints keep their positions and orientations in the world; orientations are expressed in the axes of the standard rest
pose. Joints that the file lacks do not move, with one exception: if it has a single joint for the wrist, the twist
of forearm and hand goes to `wrist`, as in the CMU database, where elbows only bend.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..body.joint_angle_frames import with_angle_frames
from ..body.motion import Motion
from ..body.skeleton import Skeleton
from ..body.source_motion import SourceMotion, every_frame, source_kinematics, source_positions
from ..body.standard_skeleton import JOINT_NAMES, default_skeleton
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from .displayed_joint_names import NAMINGS
from .file_joints import match_joints
from .file_rest_pose import align_rest

# their offsets are the thighs and upper arms, which all files have: they give the body's size
_SIZED = ("ltibia", "rtibia", "lradius", "rradius")
_Y_UP_FROM_Z_UP = rot.from_rotation_vector(np.array([-0.5 * np.pi, 0.0, 0.0]))


@lru_cache(maxsize=1)
def _default() -> Skeleton:
    return with_angle_frames(default_skeleton())


def to_standard_skeleton(source: SourceMotion) -> Motion:
    """Return the motion on the standard skeleton with the bone lengths of the file.

    Files with the standard joints and hierarchy, under any of the joint names that exports use, only have their joints
    reordered.

    Raises:
        SkeletonError: Needed joints are missing, or the rest pose is unknown.
    """
    written = _with_own_names(source)
    if written is not None and _has_standard_parents(written):
        return _reordered(written)
    found = match_joints(source)
    alignment = align_rest(source, found)
    found = {name: joint for name, joint in found.items() if name in alignment}
    upright = _Y_UP_FROM_Z_UP if _lies_along_z(source, found) else rot.identity()
    skeleton = _skeleton(found, _links(source, found, alignment), _known_tips(source, found, alignment))
    rotations = _local_rotations(source, found, alignment)
    positions, world = _path_of(source, found["root"])
    rotations[:, 0] = rot.multiply(rot.multiply(upright, world), alignment["root"])
    sides = [side for side in "lr" if side + "wrist" not in found and side + "hand" in found]
    if sides:
        _move_twist_to_wrists(rotations, skeleton, sides)
    return Motion(source.name, source.fps, skeleton, rot.continuous(rotations), rot.rotate(upright, positions))


def _with_own_names(source: SourceMotion) -> SourceMotion | None:
    """Return a motion with standard joint names, or None if it has other joints."""
    for naming in NAMINGS.values():
        if set(source.names) == set(naming.values()):
            own = {theirs: ours for ours, theirs in naming.items()}
            return replace(source, names=tuple(own[name] for name in source.names))
    return None


def _has_standard_parents(source: SourceMotion) -> bool:
    default = _default()
    for joint, parent in enumerate(source.parents):
        expected = int(default.parents[default.index(source.names[joint])])
        if (source.names[parent] if parent >= 0 else "") != (JOINT_NAMES[expected] if expected >= 0 else ""):
            return False
    return True


def _reordered(source: SourceMotion) -> Motion:
    order = [source.names.index(name) for name in JOINT_NAMES]
    offsets = source.offsets_m[order].copy()
    offsets[0] = 0.0
    tips = _tips(offsets, {n: t for n, t in zip(JOINT_NAMES, source.tips_m[order], strict=True) if np.any(t)})
    skeleton = replace(_default(), offsets_m=offsets, tips_m=tips)
    return Motion(source.name, source.fps, skeleton, source.rotations[:, order], source.translations_m[0])


def _tips(offsets: Array, known: Mapping[str, Array]) -> Array:
    """Return the ends of the bones: the known ones, otherwise the child joints at their ends."""
    tips = _default().tips_m.copy()
    tips[0] = 0.0
    for joint, child in _bone_ends().items():
        tips[joint] = offsets[child]
    for name, tip in known.items():
        tips[JOINT_NAMES.index(name)] = tip
    return tips


@lru_cache(maxsize=1)
def _bone_ends() -> dict[int, int]:
    """Return joint -> child joint at the end of its bone, without the root."""
    default = _default()
    ends: dict[int, int] = {}
    for child, joint in enumerate(default.parents):
        if joint > 0 and np.allclose(default.offsets_m[child], default.tips_m[joint]):
            ends.setdefault(int(joint), child)
    return ends


def _lies_along_z(source: SourceMotion, found: Mapping[str, int]) -> bool:
    """Return whether the body is upright along z: its median extent there, in 20 frames, is three times that in y."""
    positions = source_positions(every_frame(source, -(-source.frames // 20)))
    head = found.get("head", found["lhumerus"])
    heights = positions[:, head] - 0.5 * (positions[:, found["ltibia"]] + positions[:, found["rtibia"]])
    along = np.sort(heights, axis=0)[len(heights) // 2]
    return bool(along[2] > 3.0 * abs(along[1]))


def _path_of(source: SourceMotion, joint: int) -> tuple[Array, Array]:
    """Return world positions (F, 3) and orientations (F, 4) of one joint in a file."""
    line = _line(source.parents, joint)
    world = source.rotations[:, line[0]]
    positions = source.translations_m[line[0]]
    for below in line[1:]:
        positions = positions + rot.rotate(world, source.translations_m.get(below, source.offsets_m[below]))
        world = rot.multiply(world, source.rotations[:, below])
    return positions, world


def _line(parents: IntArray, joint: int) -> list[int]:
    """Return the joints from the root down to a joint."""
    line = [joint]
    while parents[line[0]] >= 0:
        line.insert(0, int(parents[line[0]]))
    return line


def _local_rotations(source: SourceMotion, found: Mapping[str, int], alignment: Mapping[str, Array]) -> Array:
    """Return local rotations (F, J, 4) of the joints found, except the root's."""
    local = rot.identity((source.frames, len(JOINT_NAMES)))
    names, anchors = tuple(found)[1:], _anchors(tuple(found))
    turned = source.rotations[:, [found[name] for name in names]]
    for place, (name, anchor) in enumerate(zip(names, anchors, strict=True)):
        if source.parents[found[name]] != found[anchor]:
            turned[:, place] = _turn_between(source, found[anchor], found[name])
    before = rot.conjugate(np.array([alignment[anchor] for anchor in anchors]))
    after = np.array([alignment[name] for name in names])
    local[:, [JOINT_NAMES.index(name) for name in names]] = rot.multiply(rot.multiply(before, turned), after)
    return local


def _turn_between(source: SourceMotion, upper: int, lower: int) -> Array:
    """Return upper-from-lower rotations (F, 4) of two joints of a file."""
    above, below = _line(source.parents, upper), _line(source.parents, lower)
    if above != below[: len(above)]:  # `upper` is not an ancestor
        return rot.multiply(rot.conjugate(_path_of(source, upper)[1]), _path_of(source, lower)[1])
    turn = source.rotations[:, below[len(above)]]
    for joint in below[len(above) + 1 :]:
        turn = rot.multiply(turn, source.rotations[:, joint])
    return turn


@lru_cache(maxsize=64)
def _anchors(found: tuple[str, ...]) -> tuple[str, ...]:
    """Return the nearest ancestor in the file for each joint except the root."""
    above = [[*_missing_between(name, found), name][0] for name in found[1:]]
    return tuple(JOINT_NAMES[_default().parents[JOINT_NAMES.index(name)]] for name in above)


def _move_twist_to_wrists(rotations: Array, skeleton: Skeleton, sides: Sequence[str]) -> None:
    """Move the twists of forearm and hand to the wrist, which does not change positions."""
    radius, wrist, hand = ([skeleton.index(side + name) for side in sides] for name in ("radius", "wrist", "hand"))
    axes = skeleton.offsets_m[wrist] / np.maximum(rot.lengths(skeleton.offsets_m[wrist]), 1e-9)[:, None]
    swing, twist = rot.swing_twist(rotations[:, radius], axes)
    rotations[:, radius] = swing
    below = rot.multiply(twist, rotations[:, hand])
    # hand = twist * swing, in this order because the wrist is above the hand
    inverse_swing, inverse_twist = rot.swing_twist(rot.conjugate(below), axes)
    rotations[:, wrist] = rot.conjugate(inverse_twist)
    rotations[:, hand] = rot.conjugate(inverse_swing)


def _links(source: SourceMotion, found: Mapping[str, int], alignment: Mapping[str, Array]) -> Array:
    """Return offsets (N, 3) of the joints found, except the root, from their nearest ancestors found.

    If the file has further joints between them, the offsets are means over 200 frames.
    """
    names, anchors = tuple(found)[1:], _anchors(tuple(found))
    joints = [found[name] for name in names]
    axes = rot.conjugate(np.array([alignment[anchor] for anchor in anchors]))
    links = rot.rotate(axes, source.offsets_m[joints])
    loose = [
        place
        for place, (joint, anchor) in enumerate(zip(joints, anchors, strict=True))
        if source.parents[joint] != found[anchor] or joint in source.translations_m
    ]
    if loose:
        positions, world = source_kinematics(every_frame(source, max(1, source.frames // 200)))
        for place in loose:
            above = found[anchors[place]]
            axes_above = rot.multiply(world[:, above], alignment[anchors[place]])
            apart = positions[:, joints[place]] - positions[:, above]
            links[place] = np.mean(rot.rotate(rot.conjugate(axes_above), apart), axis=0)
    return links


def _skeleton(found: Iterable[str], links: Array, tips: Mapping[str, Array]) -> Skeleton:
    known = tuple((name, tuple(tip.tolist())) for name, tip in tips.items())
    return _skeleton_of(tuple(found), links.tobytes(), known)


@lru_cache(maxsize=64)  # clips of one data set share a few skeletons
def _skeleton_of(
    found: tuple[str, ...], links_m: bytes, known_tips: tuple[tuple[str, tuple[float, ...]], ...]
) -> Skeleton:
    default = _default()
    links = dict(zip(found[1:], np.frombuffer(links_m).reshape(-1, 3), strict=True))
    lengths = {name: float(np.linalg.norm(link)) for name, link in links.items()}
    usual_size = sum(float(np.linalg.norm(default.offsets_m[default.index(name)])) for name in _SIZED)
    scale = sum(lengths[name] for name in _SIZED) / usual_size
    offsets = scale * default.offsets_m
    placed: set[int] = set()  # a missing wrist is placed with the hand, which comes before the thumb
    for name, link in links.items():
        path = [default.index(joint) for joint in (*_missing_between(name, found), name)]
        usual = np.linalg.norm(np.sum(default.offsets_m[path], axis=0))
        for joint in set(path[:-1]) - placed:
            offsets[joint] = default.offsets_m[joint] * (lengths[name] / usual if usual > 0.0 else 0.0)
            if name.endswith("hand"):  # forearm and wrist are one straight bone
                offsets[joint] = link * (np.linalg.norm(default.offsets_m[joint]) / usual)
        placed |= set(path[:-1])
        offsets[path[-1]] = link - np.sum(offsets[path[:-1]], axis=0)
    tips = {name: scale * default.tips_m[joint] for joint, name in enumerate(JOINT_NAMES) if joint in _leaves()}
    ends = _tips(offsets, tips | {name: np.array(tip) for name, tip in known_tips})
    return replace(default, offsets_m=offsets, tips_m=ends)


@lru_cache(maxsize=1)
def _leaves() -> frozenset[int]:
    """Return the joints of the standard skeleton without children."""
    default = _default()
    return frozenset(set(range(len(default))) - set(default.parents.tolist()))


def _missing_between(name: str, found: Container[str]) -> list[str]:
    """Return the missing joints between a joint and its nearest ancestor in the file, the topmost first."""
    default = _default()
    missing: list[str] = []
    joint = int(default.parents[default.index(name)])
    while JOINT_NAMES[joint] not in found:
        missing.append(JOINT_NAMES[joint])
        joint = int(default.parents[joint])
    return missing[::-1]


def _known_tips(source: SourceMotion, found: Mapping[str, int], alignment: Mapping[str, Array]) -> dict[str, Array]:
    """Return the ends of the outermost bones if the file gives them."""
    names = [JOINT_NAMES[joint] for joint in sorted(_leaves()) if JOINT_NAMES[joint] in found]
    ends = source.tips_m[[found[name] for name in names]]
    turned = rot.rotate(rot.conjugate(np.array([alignment[name] for name in names]).reshape(-1, 4)), ends)
    usable = rot.lengths(ends) > 0.01  # metres
    return {name: tip for name, tip, is_usable in zip(names, turned, usable, strict=True) if is_usable}

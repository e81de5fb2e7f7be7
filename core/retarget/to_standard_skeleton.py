"""Motion of any skeleton, converted to the standard skeleton's joints.

Each joint found keeps its place and its orientation in the world; only the axes in which the orientation is expressed
change, to the product's rest pose. So the positions of the joints found stay as they are, exactly, as long as no joint
of the file between them is left out. What the file lacks stands still, but for one thing: where a file has one joint
for the wrist, the twist of the forearm and of the hand goes to `wrist`, as in the CMU database, where elbows only bend.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..body.joint_angle_frames import with_angle_frames
from ..body.motion import Motion
from ..body.skeleton import Skeleton
from ..body.source_motion import SourceMotion, source_kinematics
from ..body.standard_skeleton import JOINT_NAMES, default_skeleton
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from .file_joints import match_joints
from .file_rest_pose import align_rest
from .joint_naming import NAMINGS

_SIZED = ("ltibia", "rtibia", "lradius", "rradius")  # thighs and upper arms, which all files have, give the body's size
_SAMPLED_FRAMES = 200  # for bones between joints that are not neighbours in the file
_Y_UP_FROM_Z_UP = rot.from_rotation_vector(np.array([-0.5 * np.pi, 0.0, 0.0]))
_HIPS_ARE_TIPPED = 3.0  # how much more of the body must lie along z than along y to call a file Z up


@lru_cache(maxsize=1)
def _default() -> Skeleton:
    return with_angle_frames(default_skeleton())


@lru_cache(maxsize=1)
def _default_size() -> float:
    default = _default()
    return sum(float(np.linalg.norm(default.offsets_m[default.index(name)])) for name in _SIZED)


def _with_offsets(offsets_m: Array, tips_m: Array) -> Skeleton:
    return replace(_default(), offsets_m=offsets_m, tips_m=tips_m)


def to_standard_skeleton(source: SourceMotion) -> Motion:
    """Return the motion on the product's 29 joints with the bone lengths of the file.

    Files with the standard skeleton's joints and hierarchy, under any names that it writes, are taken as they are.

    Raises:
        SkeletonError: needed joints are missing, or the rest pose is unknown.
    """
    written = _with_own_names(source)
    if written is not None and _has_product_parents(written):
        return _renamed(written)
    found = match_joints(source)
    alignment = align_rest(source, found)
    found = {name: joint for name, joint in found.items() if name in alignment}
    positions, world = _y_up(*source_kinematics(source), found)
    product_world = {name: rot.multiply(world[:, joint], alignment[name]) for name, joint in found.items()}
    skeleton = _skeleton(source, found, positions, product_world, alignment)
    rotations = _local_rotations(product_world, skeleton.parents, source.frames)
    for side in "lr":
        if side + "wrist" not in found and side + "hand" in found:
            _move_twist_to_wrist(rotations, skeleton, side)
    return Motion(source.name, source.fps, skeleton, rot.continuous(rotations), positions[:, found["root"]])


def _with_own_names(source: SourceMotion) -> SourceMotion | None:
    """Return a file under standard joint names, None for one with other joints."""
    for naming in NAMINGS.values():
        if set(source.names) == set(naming.values()):
            own = {theirs: ours for ours, theirs in naming.items()}
            return replace(source, names=tuple(own[name] for name in source.names))
    return None


def _has_product_parents(source: SourceMotion) -> bool:
    default = _default()
    for joint, parent in enumerate(source.parents):
        expected = int(default.parents[default.index(source.names[joint])])
        if (source.names[parent] if parent >= 0 else "") != (JOINT_NAMES[expected] if expected >= 0 else ""):
            return False
    return True


def _renamed(source: SourceMotion) -> Motion:
    """Return the motion of a file with the standard joints, only reordered."""
    order = [source.names.index(name) for name in JOINT_NAMES]
    offsets = source.offsets_m[order].copy()
    offsets[0] = 0.0
    default = _default()
    tips = _tips(offsets, {n: t for n, t in zip(JOINT_NAMES, source.tips_m[order], strict=True) if np.any(t)}, default)
    skeleton = _with_offsets(offsets, tips)
    return Motion(source.name, source.fps, skeleton, source.rotations[:, order], source.translations_m[0])


def _tips(offsets: Array, known: Mapping[str, Array], default: Skeleton) -> Array:
    """Return the bones' ends: as known, else the child joint at the bone's end."""
    tips = default.tips_m.copy()
    tips[0] = 0.0
    for joint, child in _bone_ends().items():
        tips[joint] = offsets[child]
    for name, tip in known.items():
        tips[JOINT_NAMES.index(name)] = tip
    return tips


@lru_cache(maxsize=1)
def _bone_ends() -> dict[int, int]:
    """Return joint -> child joint that lies at the end of its bone, the root left out."""
    default = _default()
    ends: dict[int, int] = {}
    for child, joint in enumerate(default.parents):
        if joint > 0 and np.allclose(default.offsets_m[child], default.tips_m[joint]):
            ends.setdefault(int(joint), child)
    return ends


def _y_up(positions: Array, world: Array, found: Mapping[str, int]) -> tuple[Array, Array]:
    """Turn a file with bodies along z."""
    head = found.get("head", found["lhumerus"])
    along = np.median(
        positions[:, head] - 0.5 * (positions[:, found["ltibia"]] + positions[:, found["rtibia"]]), axis=0
    )
    if along[2] > _HIPS_ARE_TIPPED * abs(along[1]):
        return rot.rotate(_Y_UP_FROM_Z_UP, positions), rot.multiply(_Y_UP_FROM_Z_UP, world)
    return positions, world


def _local_rotations(world: Mapping[str, Array], parents: IntArray, frames: int) -> Array:
    local = rot.identity((frames, len(JOINT_NAMES)))
    complete: list[Array] = []
    for joint, name in enumerate(JOINT_NAMES):
        above = complete[parents[joint]] if joint else rot.identity((frames,))
        complete.append(world.get(name, above))
        if name in world:
            local[:, joint] = rot.multiply(rot.conjugate(above), world[name])
    return local


def _move_twist_to_wrist(rotations: Array, skeleton: Skeleton, side: str) -> None:
    """Move the twist of forearm and hand to the wrist; positions do not change."""
    radius, wrist, hand = (skeleton.index(side + name) for name in ("radius", "wrist", "hand"))
    axis = skeleton.offsets_m[wrist] / max(float(np.linalg.norm(skeleton.offsets_m[wrist])), 1e-9)
    swing, twist = rot.swing_twist(rotations[:, radius], axis)
    rotations[:, radius] = swing
    below = rot.multiply(twist, rotations[:, hand])
    # hand = twist * swing, so that the hand's own rotation comes after the wrist's
    inverse_swing, inverse_twist = rot.swing_twist(rot.conjugate(below), axis)
    rotations[:, wrist] = rot.conjugate(inverse_twist)
    rotations[:, hand] = rot.conjugate(inverse_swing)


def _skeleton(
    source: SourceMotion,
    found: Mapping[str, int],
    positions: Array,
    product_world: Mapping[str, Array],
    alignment: Mapping[str, Array],
) -> Skeleton:
    default = _default()
    step = max(1, len(positions) // _SAMPLED_FRAMES)
    links: dict[str, tuple[list[str], Array]] = {}  # joints between, and the offset from the next one above them
    for name in JOINT_NAMES[1:]:
        if name not in found:
            continue
        between = _missing_between(name, found, default)
        anchor = JOINT_NAMES[default.parents[default.index(between[0] if between else name)]]
        joint = found[name]
        if source.parents[joint] == found[anchor] and joint not in source.translations_m:
            link = rot.rotate(rot.conjugate(alignment[anchor]), source.offsets_m[joint])
        else:
            apart = positions[::step, joint] - positions[::step, found[anchor]]
            link = np.mean(rot.rotate(rot.conjugate(product_world[anchor][::step]), apart), axis=0)
        links[name] = between, link
    lengths = {name: float(np.linalg.norm(link)) for name, (_, link) in links.items()}
    scale = sum(lengths[name] for name in _SIZED) / _default_size()
    offsets = scale * default.offsets_m
    placed: set[int] = set()  # thumb and hand both hang on a wrist that files lack: the hand comes first and decides
    for name, (between, link) in links.items():
        path = [default.index(joint) for joint in (*between, name)]
        usual = np.linalg.norm(np.sum(default.offsets_m[path], axis=0))
        for joint in set(path[:-1]) - placed:
            offsets[joint] = default.offsets_m[joint] * (lengths[name] / usual if usual > 0.0 else 0.0)
            if name.endswith("hand"):  # forearm and wrist are one straight bone
                offsets[joint] = link * (np.linalg.norm(default.offsets_m[joint]) / usual)
        placed |= set(path[:-1])
        offsets[path[-1]] = link - np.sum(offsets[path[:-1]], axis=0)
    tips = _tips(offsets, _known_tips(source, found, alignment, scale), default)
    return _with_offsets(offsets, tips)


def _missing_between(name: str, found: Mapping[str, int], default: Skeleton) -> list[str]:
    """Return the joints missing in the file above a joint, from above."""
    missing: list[str] = []
    joint = int(default.parents[default.index(name)])
    while JOINT_NAMES[joint] not in found:
        missing.append(JOINT_NAMES[joint])
        joint = int(default.parents[joint])
    return missing[::-1]


def _known_tips(
    source: SourceMotion, found: Mapping[str, int], alignment: Mapping[str, Array], scale: float
) -> dict[str, Array]:
    """Return the ends of the outermost bones: the file's, else scaled defaults."""
    default = _default()
    tips = {}
    for joint, name in enumerate(JOINT_NAMES):
        if joint in default.parents:
            continue
        tips[name] = scale * default.tips_m[joint]
        if name in found and np.linalg.norm(source.tips_m[found[name]]) > 0.01:
            tips[name] = rot.rotate(rot.conjugate(alignment[name]), source.tips_m[found[name]])
    return tips

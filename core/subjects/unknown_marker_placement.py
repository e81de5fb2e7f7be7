"""Placement of markers that are in no marker set, from a take's motion.

A marker that stays in place in a bone's frame is worn on that bone. For bones whose poses the known markers determine,
this can be tested directly. A limb that no known marker determines is first fitted to the unknown markers: its first
bone points at one of them, its second bone at another, the same two in all frames. The pair is chosen so that the
markers move least in the frames of the bones and are closest to them. Then poses and positions are estimated
alternately.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..body.skeleton import Skeleton, forward_kinematics
from ..database.store import Database
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, evenly, median_of_known
from ..geometry.gated_assignment import assign
from ..markers.marker_set import FEWEST_TORSO, Marker
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..markers.take_frames import is_unnamed, take_frames
from ..session.limb_coverage import LIMBS
from ..session.session import Session
from ..solver.marker_selection import worn_in
from ..system.progress import Progress, no_progress
from .body_change import observed_positions
from .from_motion import frames_of


@dataclass(frozen=True)
class PlacementSettings:
    """Settings of the placement."""

    frames: int = 16  # number of frames, spread over the take
    fewest: int = 4  # fewest of these frames in which a marker must be visible
    rounds: int = 2
    moved_share: float = 0.5  # applied fraction of each update of a position, because positions drift along a limb
    spread_m: float = 0.02  # expected spread of a marker's position on its bone: skin motion and errors of the poses
    flesh_m: float = 0.08  # expected distance of a marker from its bone
    explained: float = 2.0  # cost on a determined bone below which a marker is not tried on undetermined limbs
    unexplained: float = 6.0  # cost of a marker that is on no bone, when fits of a limb are compared
    largest_spread_m: float = 0.05  # largest spread of a marker's position on its bone
    farthest_m: float = 0.2  # largest distance of a worn marker from its bone
    # distance up to which a placed marker is identified with a marker of the set or with a placed one's mirror image
    usual_m: float = 0.08
    # largest relative difference between the length of a limb's first bone and the distance to the marker at which it
    # points
    size_share: float = 0.4
    every: int = 2  # step between the frames to which a limb is fitted
    hand_m: float = 0.15  # length of hand or foot beyond wrist or ankle


_S = PlacementSettings()
_MIRROR = np.array([-1.0, 1.0, 1.0])
_LOOSE = ("fingers", "thumb")  # joints that are not tried, because few markers determine their poses


@dataclass(frozen=True)
class _Limb:
    """Joints of an undetermined limb: those at which its first bone, its second bone and its hand or foot begin."""

    first: int
    second: int
    end: int

    @classmethod
    def of(cls, limb: str, skeleton: Skeleton) -> "_Limb":
        names = ("humerus", "radius", "wrist") if limb.endswith("arm") else ("femur", "tibia", "foot")
        return cls(*(skeleton.index(limb[0] + name) for name in names))


def place_markers(take: MarkerTake, subject: Subject, database: Database, progress: Progress = no_progress) -> Subject:
    """Return the subject with those unknown markers of a take added whose positions the motion shows.

    Args:
        take: Take with y up, labelled with the names of the subject's marker set.
        subject: Body with usual or measured offsets; its bones are kept.
        database: Database that completes the poses where known markers are lacking.
    """
    shown = [name for name, visible in zip(take.names, take.visible.T, strict=True) if visible.any()]
    unknown = [name for name in shown if name not in subject.marker_set.names]
    start = worn_in(take, subject)
    seen = np.isfinite(observed_positions(take, start.marker_set)[:, start.marker_set.torso, 0])
    frames = np.flatnonzero(seen.sum(axis=1) >= FEWEST_TORSO)
    if is_unnamed(take) or not unknown or not len(frames):
        return subject
    chosen = frames[evenly(len(frames), _S.frames)]
    part = frames_of(take, chosen)
    unknown = [name for name in unknown if part.visible[:, part.names.index(name)].sum() >= _S.fewest]
    if not unknown:
        return subject
    points_m = part.positions_m[:, [part.names.index(name) for name in unknown]]
    progress(0.0, "placing unknown markers")
    places = _first_places(part, start, database, unknown, points_m)
    for round_ in range(_S.rounds):
        progress((1.0 + round_) / (1.0 + _S.rounds), "placing unknown markers")
        local_m = _local_places(part, _wearing(start, places), database, points_m)
        places = _kept_places(local_m, subject.skeleton, unknown, places)
    return _wearing(subject, places)


def _wearing(subject: Subject, places: tuple[Marker, ...]) -> Subject:
    worn = subject.marker_set
    return replace(subject, marker_set=replace(worn, markers=(*worn.markers, *places)))


def with_usual_offsets(subject: Subject, names: Sequence[str]) -> Subject:
    """Return the subject with placed markers moved onto nearby markers of the set, or made symmetric.

    The motion shows where a marker is along a bone, but hardly how thick the flesh below it is.

    Args:
        names: Names in the take. Placed markers are moved only onto markers of the set that the take lacks.
    """
    markers, skeleton = subject.marker_set.markers, subject.skeleton
    rest = rot.identity((len(skeleton),))
    rest_m = subject.marker_set.positions_on(skeleton, rest)
    placed = np.array([i for i, marker in enumerate(markers) if marker.placed], dtype=np.int64)
    missing = [i for i, marker in enumerate(markers) if not marker.placed and marker.name not in names]
    left, right = placed[rest_m[placed, 0] > 0.0], placed[rest_m[placed, 0] < 0.0]
    pairs = [side[of] for side, of in zip((left, right), _nearest(rest_m[left] * _MIRROR, rest_m[right]), strict=True)]
    middle_m = 0.5 * (rest_m[pairs[0]] + rest_m[pairs[1]] * _MIRROR)
    rest_m[pairs[0]], rest_m[pairs[1]] = middle_m, middle_m * _MIRROR
    joints_m = forward_kinematics(skeleton, rest, np.zeros(3))[0]
    moved = list(markers)
    for i in placed.tolist():
        offset_m = rest_m[i] - joints_m[skeleton.index(markers[i].joint)]
        moved[i] = replace(markers[i], offset_m=tuple(offset_m.tolist()))
    for i, usual in zip(*_nearest(rest_m[placed], rest_m[missing]), strict=True):
        at = markers[missing[usual]]
        moved[placed[i]] = replace(markers[placed[i]], joint=at.joint, offset_m=at.offset_m)
    return replace(subject, marker_set=replace(subject.marker_set, markers=tuple(moved)))


def _nearest(points_m: Array, others_m: Array) -> tuple[IntArray, IntArray]:
    """Return indices (K,) of points (N, 3) and (K,) of others (M, 3) that are near each other, matched one to one."""
    return assign(np.linalg.norm(points_m[:, None] - others_m, axis=-1) / _S.usual_m)


def solved_poses(part: MarkerTake, subject: Subject, database: Database) -> tuple[Array, Array]:
    """Return joint rotations (F, J, 4) and root positions (F, 3); each frame is solved separately."""
    session = Session(subject, database)
    poses = []
    for frame in take_frames(part, subject.marker_set):
        session.reset()
        poses.append(session.step(frame))
    return np.array([pose.rotations for pose in poses]), np.array([pose.root_position_m for pose in poses])


def _in_bones(points_m: Array, positions_m: Array, world: Array) -> Array:
    """Return points (F, U, 3) in the frames of all joints (F, U, J, 3)."""
    return rot.rotate(rot.conjugate(world)[:, None], points_m[:, :, None] - positions_m[:, None])


def _local_places(part: MarkerTake, subject: Subject, database: Database, points_m: Array) -> Array:
    return _in_bones(points_m, *forward_kinematics(subject.skeleton, *solved_poses(part, subject, database)))


def _first_places(
    part: MarkerTake, start: Subject, database: Database, unknown: list[str], points_m: Array
) -> tuple[Marker, ...]:
    """Return the unknown markers at initial positions on determined bones, or on undetermined limbs fitted to them."""
    skeleton = start.skeleton
    positions_m, world = forward_kinematics(skeleton, *solved_poses(part, start, database))
    local_m = _in_bones(points_m, positions_m, world)
    shown = [name for name, visible in zip(part.names, part.visible.T, strict=True) if visible.any()]
    has_joint = {marker.joint for marker in start.marker_set.markers if marker.name in shown}
    limbs = [_Limb.of(name, skeleton) for name, joints in LIMBS.items() if not has_joint & set(joints)]
    is_open = skeleton.is_ancestor[:, [limb.first for limb in limbs]].any(axis=1)
    costs, offsets_m = _costs(local_m, skeleton)
    costs[:, is_open] = np.inf
    free = ~(costs.min(axis=1) < _S.explained)
    points_m = np.where(free[:, None], points_m, np.nan)
    while limbs:
        found = [_directed(limb, skeleton, points_m, positions_m[:, limb.first], costs) for limb in limbs]
        most = int(np.argmax([gain for gain, _ in found]))
        gain, pair = found[most]
        if gain <= _S.unexplained:  # a limb that points at two markers always explains these two
            break
        limb = limbs.pop(most)
        _lay(limb, skeleton, points_m, positions_m[:, limb.first], pair, costs, offsets_m)
    return _chosen(costs, offsets_m, skeleton, unknown)


def _nearest_on_bones(local_m: Array, skeleton: Skeleton) -> Array:
    """Return the points on the bones (..., J, 3) that are nearest to points given in the joints' frames (..., J, 3)."""
    tips = skeleton.tips_m
    share = np.einsum("...jx,jx->...j", local_m, tips) / np.maximum(np.sum(tips**2, axis=1), 1e-9)
    return np.clip(share, 0.0, 1.0)[..., None] * tips


def _cost(spread_m: Array, apart_m: Array) -> Array:
    """Return the costs of markers with given spreads on bones and given distances from them; inf if impossible."""
    costs = (spread_m / _S.spread_m) ** 2 + (apart_m / _S.flesh_m) ** 2
    possible = (spread_m <= _S.largest_spread_m) & (apart_m <= _S.farthest_m)
    return np.where(possible, costs, np.inf)


def _costs(local_m: Array, skeleton: Skeleton) -> tuple[Array, Array]:
    """Return costs (U, J) of markers on bones, inf for impossible ones, and their median positions (U, J, 3)."""
    offsets_m = median_of_known(local_m)
    spread_m = median_of_known(np.linalg.norm(local_m - offsets_m, axis=-1))
    apart_m = np.linalg.norm(offsets_m - _nearest_on_bones(offsets_m, skeleton), axis=-1)
    costs = _cost(spread_m, apart_m)
    costs[:, [skeleton.index(side + joint) for side in "lr" for joint in _LOOSE]] = np.inf
    return costs, offsets_m


def _lengths_m(limb: _Limb, skeleton: Skeleton) -> Array:
    lengths_m = np.linalg.norm(skeleton.offsets_m[[limb.second, limb.end]], axis=1)
    return np.append(lengths_m, _S.hand_m)


def _directed(
    limb: _Limb, skeleton: Skeleton, points_m: Array, root_m: Array, costs: Array
) -> tuple[float, tuple[int, int]]:
    """Return the best two markers for a limb to point at, preceded by how much this lowers the costs.

    Args:
        root_m: First joint of the limb (F, 3).
        costs: Costs (U, J) of the markers on the bones that are determined so far.
    """
    lengths_m = _lengths_m(limb, skeleton)
    from_root_m = median_of_known(np.linalg.norm(points_m - root_m[:, None], axis=-1))
    near = np.flatnonzero(from_root_m < lengths_m.sum() + _S.farthest_m)
    bends = near[np.abs(from_root_m[near] / lengths_m[0] - 1.0) < _S.size_share]
    others = np.fmin(costs[near].min(axis=1), _S.unexplained)
    most, best = 0.0, (0, 0)
    few = slice(None, None, _S.every)
    for bend, end in product(bends, near):
        course_m = _course(root_m[few], points_m[few, bend], points_m[few, end], lengths_m)
        own, _ = _course_costs(points_m[few][:, near], course_m, lengths_m)
        gain = float(others.sum() - np.fmin(own.min(axis=1), others).sum())
        if bend != end and gain > most:
            most, best = gain, (bend, end)
    return most, best


def _lay(
    limb: _Limb,
    skeleton: Skeleton,
    points_m: Array,
    root_m: Array,
    directed: tuple[int, int],
    costs: Array,
    offsets_m: Array,
) -> None:
    """Point a limb at two markers, and write the costs (U, J) and offsets (U, J, 3) of all markers on its bones."""
    lengths_m, joints = _lengths_m(limb, skeleton), (limb.first, limb.second, limb.end)
    course_m = _course(root_m, points_m[:, directed[0]], points_m[:, directed[1]], lengths_m)
    costs[:, joints], middle_m = _course_costs(points_m, course_m, lengths_m)
    for part, joint in enumerate(joints):
        direction = skeleton.tips_m[joint] / max(float(np.linalg.norm(skeleton.tips_m[joint])), 1e-9)
        offsets_m[:, joint] = np.clip(middle_m[:, part], 0.0, lengths_m[part])[:, None] * direction


def _course(root_m: Array, elbow_m: Array, wrist_m: Array, lengths_m: Array) -> Array:
    """Return the joints (F, 4, 3) of a limb that points at two markers one after the other."""
    joints = [root_m]
    for target, length in zip((elbow_m, wrist_m), lengths_m[:2], strict=True):
        way = target - joints[-1]
        way = way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9)
        joints.append(joints[-1] + length * way)
    return np.stack((*joints, joints[-1] + lengths_m[2] * way), axis=1)


def _course_costs(points_m: Array, course_m: Array, lengths_m: Array) -> tuple[Array, Array]:
    """Return costs (U, 3) of markers (F, U, 3) on three bones with joints (F, 4, 3), and positions (U, 3) along them.

    How a bone is turned about its axis is unknown, so only positions along it and distances from it are compared.
    """
    ways = np.diff(course_m, axis=1) / lengths_m[:, None]
    relative = points_m[:, :, None] - course_m[:, None, :3]
    along_m = np.einsum("fubx,fbx->fub", relative, ways)
    on_m = np.clip(along_m, 0.0, lengths_m)[..., None] * ways[:, None]
    apart_m = np.linalg.norm(relative - on_m, axis=-1)
    both_m = np.stack((along_m, apart_m), axis=-1)
    middle_m = median_of_known(both_m)
    spread_m = median_of_known(np.linalg.norm(both_m - middle_m, axis=-1))
    return _cost(spread_m, middle_m[..., 1]), middle_m[..., 0]


def _kept_places(
    local_m: Array, skeleton: Skeleton, unknown: list[str], places: tuple[Marker, ...]
) -> tuple[Marker, ...]:
    """Return the markers with positions from new poses: each on its bone, on a neighbouring bone, or left out."""
    costs, offsets_m = _costs(local_m, skeleton)
    allowed = np.zeros(costs.shape, dtype=bool)
    for marker in places:
        joint, row = skeleton.index(marker.joint), unknown.index(marker.name)
        allowed[row, [joint, max(int(skeleton.parents[joint]), 0)]] = True
        allowed[row, skeleton.parents == joint] = True
        offsets_m[row, joint] += (1.0 - _S.moved_share) * (np.array(marker.offset_m) - offsets_m[row, joint])
    return _chosen(np.where(allowed, costs, np.inf), offsets_m, skeleton, unknown)


def _chosen(costs: Array, offsets_m: Array, skeleton: Skeleton, unknown: list[str]) -> tuple[Marker, ...]:
    """Return each marker on the bone with the lowest cost; markers that fit no bone are left out."""
    joints: IntArray = costs.argmin(axis=1)
    return tuple(
        Marker(name, skeleton.names[joint], tuple(offsets_m[row, joint].tolist()), placed=True)
        for row, (name, joint) in enumerate(zip(unknown, joints, strict=True))
        if np.isfinite(costs[row, joint])
    )

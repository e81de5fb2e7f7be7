"""Motion of the product's skeleton onto a character: the rotations of its bones and the way of its hips.

Each bone that stands for a joint takes the joint's orientation in the world, through the alignment of the rest poses;
bones of the trunk and the neck between two such bones take what lies between, by their place along the chain. The
hips go as far as the performer's by the ratio of leg lengths, and the legs are bent (two-bone inverse kinematics, in
the knee's own plane) until the balls of the feet are where the performer's are, so that what stands still there
stands still here, whatever the proportions; hips come down where a leg is too short for that.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from .. import rotations as rot
from ..skeleton import Skeleton
from . import components as c
from .armature_rest import ArmatureRest, Array, IntArray
from .bone_map import BoneMap
from .bone_names import parse_bone_name
from .rest_align import align_character

_BALL_ABOVE_SOLE = 0.029  # height of the ball of a standing foot above the floor, in leg lengths
_REACH = 0.9995  # of the leg's length: no knee is quite straight
_SOFT = 0.005  # of the leg's length: how gently the hips begin to come down for a foot out of reach
_STANDING, _RAISED = 0.75, 0.45  # cosine between a leg and the vertical from which, and below which not, they do
_HINGE = 0.05  # weight of the knee's axis against the plane in which it is bent: it tells where a leg is straight
_CHAINS = (("root", "lowerback", "upperback", "thorax"), ("thorax", "lowerneck", "upperneck", "head"))
_FINGERS = ("index", "middle", "ring", "pinky", "little")
_IDENTITY = rot.identity()

# the matrix of a quaternion's multiplication from the left, (w, x, y, z) placed and signed
_LEFT_INDEX = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
_LEFT_SIGN = np.array([[1.0, -1.0, -1.0, -1.0], [1.0, 1.0, -1.0, 1.0], [1.0, 1.0, 1.0, -1.0], [1.0, -1.0, 1.0, 1.0]])


class RootMotion(Enum):
    """What carries the character through the room."""

    HIPS = "hips"
    ROOT_BONE = "root bone"
    OBJECT = "object"


@dataclass(frozen=True)
class CharacterPose:
    """What is set on the character; the leading shape is that of the motion.

    Args:
        rotations: (..., N, 4) rotation of each of the `Retargeter.bones` relative to its rest pose, as Blender has it.
        locations: (..., L, 3) location of each of the `Retargeter.located` bones relative to its rest pose.
        object_rotation: (..., 4), object_location: (..., 3): how the object moves in its own space, in the
            armature's unit; None unless the object carries the motion.
    """

    rotations: Array
    locations: Array
    object_rotation: Array | None
    object_location: Array | None


@dataclass(frozen=True)
class _Driven:
    """A bone and what turns it: two joints and how far between them its place is."""

    bone: int
    first: int
    second: int
    share: float
    turn: Array


@dataclass(frozen=True)
class _Leg:
    """Indices and lengths of a leg; vectors in the product's axes, `own` the performer's, all in its metres."""

    joints: tuple[int, ...]
    places: tuple[int, int]
    own_hip: c.Vector
    own_thigh_m: float
    own_shank_m: float
    thigh_way: c.Vector
    shank_way: c.Vector
    hinge: c.Vector
    thigh_m: float
    shank_m: float
    from_middle: c.Vector
    ankle_shift: c.Vector
    ball_up: float


@dataclass(frozen=True)
class _Step:
    """How the performer's thigh and shank are turned and point, and where the character's ankle belongs."""

    upper: c.Quaternion
    lower: c.Quaternion
    thigh_way: c.Vector
    shank_way: c.Vector
    ankle: c.Vector


class Retargeter:
    """Turns poses of a performer into those of a character.

    Args:
        skeleton: the performer's.
        rest: the character's armature.
        bone_map: which bone is which joint.
        root_motion: what carries the character through the room; a root bone is the topmost bone above the hips, and
            where there is none, the hips carry it.
        ancestors: (B,) for each bone the bone whose rotation it follows, -1 for none; where constraints let it follow
            another than its parent. By default the parents.

    Raises:
        CharacterError: the character's rest pose cannot be read.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        rest: ArmatureRest,
        bone_map: BoneMap,
        root_motion: RootMotion = RootMotion.HIPS,
        ancestors: IntArray | None = None,
    ) -> None:
        self.skeleton = skeleton
        self.joints = {joint: rest.index[bone] for joint, bone in bone_map.bones.items()}
        self.alignment = align_character(skeleton, rest, self.joints)
        self._hips = self.joints["root"]
        self.root_motion = root_motion
        self._root_bone = _root_bone(rest, self._hips) if root_motion is RootMotion.ROOT_BONE else -1
        if root_motion is RootMotion.ROOT_BONE and self._root_bone < 0:
            self.root_motion = RootMotion.HIPS
        driven = _driven_bones(skeleton, rest, self.joints, self.alignment.turns)
        self._order = [entry.bone for entry in driven]
        self._first = np.array([entry.first for entry in driven])
        self._second = np.array([entry.second for entry in driven])
        self._share = np.array([entry.share for entry in driven])[:, None]
        self._between = np.flatnonzero(self._share[:, 0] > 0.0)
        self._place = {bone: place for place, bone in enumerate(self._order)}
        axes = rot.from_matrix(self.alignment.armature_from_product.T @ rest.axes)
        self._rest_axes = axes
        self._ancestors = _driven_ancestors(rest, self._order, ancestors)
        self._free = np.flatnonzero(self._ancestors < 0)
        self._jumps = _jumps(skeleton.parents)
        self._maps = self._bone_maps(driven)
        self._prepare_legs()
        self._prepare_forearms()
        self._prepare_root(rest)
        self.bones = tuple(rest.names[bone] for bone in self._order) + (
            (rest.names[self._root_bone],) if self._root_bone >= 0 else ()
        )
        self.located = (rest.names[self._hips],) + ((rest.names[self._root_bone],) if self._root_bone >= 0 else ())

    def _bone_maps(self, driven: Sequence[_Driven]) -> Array:
        """Return (N, 4, 4): the bone's quaternion = map @ quaternion of its joint relative to its ancestor's.

        A bone stands at D C in the product's axes, with D what turns it and C = A R, the alignment A of its rest pose
        and its rest axes R. Blender wants R^-1 R_p (D_p C_p)^-1 (D C), with p the ancestor: (R^-1 R_p C_p^-1) (D_p^-1
        D) C, linear in the middle factor.
        """
        own = rot.multiply(np.array([entry.turn for entry in driven]), self._rest_axes[self._order])
        left = rot.conjugate(self._rest_axes[self._order])
        has = self._ancestors >= 0
        bones = np.array(self._order)[self._ancestors[has]]
        left[has] = rot.multiply(
            left[has], rot.multiply(self._rest_axes[bones], rot.conjugate(own[self._ancestors[has]]))
        )
        basis = np.eye(4)[None]
        columns = rot.multiply(rot.multiply(left[:, None], basis), own[:, None])
        return np.ascontiguousarray(np.swapaxes(columns, -1, -2))

    def _prepare_legs(self) -> None:
        skeleton, heads, joints = self.skeleton, self.alignment.heads_m, self.joints
        middle = 0.5 * (heads[joints["lfemur"]] + heads[joints["rfemur"]])
        self._hips_to_middle: c.Vector = c.components(middle - heads[joints["root"]])
        thighs = skeleton.offsets_m[[skeleton.index(side + "femur") for side in "lr"]]
        self._own_middle: c.Vector = c.components(np.mean(thighs, axis=0))
        self._legs: list[_Leg] = []  # a leg without knee or ankle keeps what its joints have
        up = []
        for side in "lr":
            if not all(side + name in joints for name in ("femur", "tibia", "foot")):
                continue
            thigh, shank, own_ball = (skeleton.offsets_m[skeleton.index(side + n)] for n in ("tibia", "foot", "toes"))
            femur, tibia, foot = (joints[side + name] for name in ("femur", "tibia", "foot"))
            to_ball = own_ball
            if side + "toes" in joints:
                to_ball = rot.rotate(self.alignment.turns[side + "foot"], heads[joints[side + "toes"]] - heads[foot])
            lengths = [float(np.linalg.norm(heads[b] - heads[a])) for a, b in ((femur, tibia), (tibia, foot))]
            # how much higher than the performer's the ball of a standing foot is, and with it ankle and hips
            ball_up = float(heads[foot, 1] + to_ball[1]) - _BALL_ABOVE_SOLE * sum(lengths)
            up.append(ball_up - float(to_ball[1] - own_ball[1]))
            # a knee bends the shank backwards: down x back is to the left
            hinge = np.cross(thigh, [0.0, 0.0, -1.0])
            self._legs.append(
                _Leg(
                    joints=tuple(skeleton.index(side + name) for name in ("femur", "tibia", "foot")),
                    places=(self._place[femur], self._place[tibia]),
                    own_hip=c.components(skeleton.offsets_m[skeleton.index(side + "femur")]),
                    own_thigh_m=float(np.linalg.norm(thigh)),
                    own_shank_m=float(np.linalg.norm(shank)),
                    thigh_way=c.unit(c.components(thigh)),
                    shank_way=c.unit(c.components(shank)),
                    hinge=c.unit(c.components(hinge)),
                    thigh_m=lengths[0],
                    shank_m=lengths[1],
                    from_middle=c.components(heads[femur] - middle),
                    ankle_shift=c.components(own_ball - to_ball),
                    ball_up=ball_up,
                )
            )
        self._hips_up = float(np.mean(up)) if up else 0.0

    def _prepare_forearms(self) -> None:
        self._forearms: list[tuple[int, int, c.Vector]] = []
        for side in "lr":
            if side + "wrist" not in self.joints and {side + "radius", side + "hand"} <= self.joints.keys():
                way = self.skeleton.offsets_m[self.skeleton.index(side + "wrist")]
                forearm, hand = (self._place[self.joints[side + name]] for name in ("radius", "hand"))
                self._forearms.append((forearm, hand, c.unit(c.components(way))))

    def _prepare_root(self, rest: ArmatureRest) -> None:
        def location_axes(bone: int) -> Array:
            return rest.axes[bone].T if rest.local_location[bone] else np.eye(3)

        self._hips_axes, self._hips_head = location_axes(self._hips), rest.heads[self._hips]
        if self._root_bone >= 0:
            self._root_axes, self._root_head = location_axes(self._root_bone), rest.heads[self._root_bone]
            self._root_rotation = rot.from_matrix(rest.axes[self._root_bone])

    def pose(self, rotations: ArrayLike, root_positions_m: ArrayLike) -> CharacterPose:
        """Return the character's pose, of one frame or of many.

        Args:
            rotations: (J, 4) or (F, J, 4) parent-from-joint quaternions relative to rest.
            root_positions_m: (3,) or (F, 3) root in product space, metres.
        """
        world = self._world_rotations(np.asarray(rotations, dtype=np.float64))
        turned = world[..., self._first, :]
        if len(self._between):
            turned[..., self._between, :] = _between(
                turned[..., self._between, :], world[..., self._second[self._between], :], self._share[self._between]
            )
        root: c.Quaternion = c.components(world[..., 0, :])
        position: c.Vector = c.components(np.asarray(root_positions_m, dtype=np.float64))
        middle = c.plus(c.plus(position, c.rotate(root, self._own_middle)), (0.0, self._hips_up, 0.0))
        steps = [_step(leg, world, root, position) for leg in self._legs]
        hips = [c.plus(middle, c.rotate(root, leg.from_middle)) for leg in self._legs]
        if steps:
            lower = _lowering(self._legs, [c.minus(step.ankle, hip) for step, hip in zip(steps, hips, strict=True)])
            middle = c.minus(middle, (0.0, lower, 0.0))
            for leg, step, hip in zip(self._legs, steps, hips, strict=True):
                _bend_leg(leg, step, c.minus(step.ankle, c.minus(hip, (0.0, lower, 0.0))), turned)
        for forearm, hand, way in self._forearms:
            _turn_forearm(turned, forearm, hand, way)
        return self._as_blender(turned, root, c.minus(middle, c.rotate(root, self._hips_to_middle)))

    def _world_rotations(self, local: Array) -> Array:
        """Return (..., J, 4) world-from-joint quaternions: products along stretches of its line that double."""
        matrices = np.empty((*local.shape[:-2], len(self.skeleton) + 1, 4, 4))
        np.multiply(local[..., _LEFT_INDEX], _LEFT_SIGN, out=matrices[..., :-1, :, :])
        matrices[..., -1, :, :] = np.eye(4)
        for above in self._jumps:
            matrices = np.matmul(matrices[..., above, :, :], matrices)
        return matrices[..., :-1, :, 0]

    def _as_blender(self, turned: Array, root: c.Quaternion, hips_m: c.Vector) -> CharacterPose:
        above = turned[..., self._ancestors, :]
        above[..., self._free, :] = _IDENTITY
        heading = _heading(root) if self.root_motion is not RootMotion.HIPS else None
        if heading is not None:
            above[..., self._place[self._hips], :] = _stacked(heading)
        relative = np.matmul(np.swapaxes(above[..., _LEFT_INDEX] * _LEFT_SIGN, -1, -2), turned[..., None])
        bones = np.matmul(self._maps, relative)[..., 0]
        scale = self.alignment.units_per_metre
        hips = scale * _stacked(hips_m) @ self.alignment.armature_from_product.T
        if heading is None:
            return CharacterPose(bones, ((hips - self._hips_head) @ self._hips_axes.T)[..., None, :], None, None)
        turn = _in_axes(_stacked(heading), self.alignment.armature_from_product)
        way = hips - rot.rotate(turn, self._hips_head)
        up = self.alignment.armature_from_product[:, 1]
        carried = way - (way @ up)[..., None] * up  # what stays upright is left to the hips
        hips = rot.rotate(rot.conjugate(turn), hips - carried)
        locations = ((hips - self._hips_head) @ self._hips_axes.T)[..., None, :]
        if self.root_motion is RootMotion.OBJECT:
            return CharacterPose(bones, locations, turn, carried)
        axes = rot.conjugate(self._root_rotation)
        root_turn = rot.multiply(rot.multiply(axes, turn), self._root_rotation)
        moved = rot.rotate(turn, self._root_head) + carried - self._root_head
        bones = np.concatenate((bones, root_turn[..., None, :]), axis=-2)
        locations = np.concatenate((locations, (moved @ self._root_axes.T)[..., None, :]), axis=-2)
        return CharacterPose(bones, locations, None, None)


def _step(leg: _Leg, world: Array, root: c.Quaternion, position: c.Vector) -> _Step:
    """Return how the performer's leg is held, and where the character's ankle belongs."""
    upper, lower, end = (c.components(world[..., joint, :]) for joint in leg.joints)
    thigh_way, shank_way = c.rotate(upper, leg.thigh_way), c.rotate(lower, leg.shank_way)
    ankle = c.plus(position, c.rotate(root, leg.own_hip))
    ankle = c.plus(ankle, c.plus(c.times(leg.own_thigh_m, thigh_way), c.times(leg.own_shank_m, shank_way)))
    ankle = c.plus(c.plus(ankle, c.rotate(end, leg.ankle_shift)), (0.0, leg.ball_up, 0.0))
    return _Step(upper, lower, thigh_way, shank_way, ankle)


def _lowering(legs: Sequence[_Leg], reaches: Sequence[c.Vector]) -> c.Part:
    """Return by how much the hips must come down for the feet to be reached, in metres; nothing for raised legs.

    Args:
        reaches: from each hip to where its ankle belongs.
    """
    lowest: c.Part = 0.0
    for leg, reach in zip(legs, reaches, strict=True):
        limit = _REACH * (leg.thigh_m + leg.shank_m)
        across = reach[0] * reach[0] + reach[2] * reach[2]
        down = -reach[1]
        over = down - c.larger(limit * limit - across, 0.0) ** 0.5
        over = 0.5 * (over + (over * over + (_SOFT * limit) ** 2) ** 0.5)
        steep = (down / ((across + down * down) ** 0.5 + 1e-9) - _RAISED) / (_STANDING - _RAISED)
        lowest = c.larger(lowest, over * c.smaller(c.larger(steep, 0.0), 1.0))
    return lowest


def _bend_leg(leg: _Leg, step: _Step, reach: c.Vector, turned: Array) -> None:
    """Turn thigh and shank until the ankle is where it belongs, `reach` from the hip."""
    normal = c.plus(c.cross(step.thigh_way, step.shank_way), c.times(_HINGE, c.rotate(step.upper, leg.hinge)))
    unreached = c.plus(c.times(leg.thigh_m, step.thigh_way), c.times(leg.shank_m, step.shank_way))
    thigh, shank = two_bone_directions(reach, normal, leg.thigh_m, leg.shank_m, unreached)
    for place, before, after, turn in (
        (leg.places[0], step.thigh_way, thigh, step.upper),
        (leg.places[1], step.shank_way, shank, step.lower),
    ):
        turned[..., place, :] = _stacked(c.multiply(c.shortest_turn(before, after), turn))


def two_bone_directions(
    reach: c.Vector, normal: c.Vector, first_m: float, second_m: float, unreached: c.Vector
) -> tuple[c.Vector, c.Vector]:
    """Return the directions of two bones that end at `reach` from where they begin.

    Args:
        reach: where the second bone should end; beyond the bones' length, as near as can be.
        normal: of the plane in which the joint between them bends, when they end at `unreached`; it goes along when
            the limb is turned from there.
        first_m, second_m: lengths.
        unreached: where the bones end before.
    """
    way = c.unit(reach)
    distance = c.smaller(c.larger(c.length(reach), abs(first_m - second_m) + 1e-6), _REACH * (first_m + second_m))
    across = c.rotate(c.shortest_turn(c.unit(unreached), way), normal)
    across = c.unit(c.minus(across, c.times(c.dot(across, way), way)))
    cosine = c.smaller((first_m**2 + distance**2 - second_m**2) / (2.0 * first_m * distance), 1.0)
    sine = (1.0 - cosine * cosine) ** 0.5
    first = c.plus(c.times(cosine, way), c.times(sine, c.cross(way, across)))
    return first, c.unit(c.minus(c.times(distance, way), c.times(first_m, first)))


def _turn_forearm(turned: Array, forearm: int, hand: int, way: c.Vector) -> None:
    """Turn a forearm half as far about itself as its hand: skin is not wrung where there is no wrist bone."""
    turn = c.components(turned[..., forearm, :])
    w, x, y, z = c.multiply(c.conjugate(turn), c.components(turned[..., hand, :]))
    along = x * way[0] + y * way[1] + z * way[2]
    size = (w * w + along * along + 1e-18) ** 0.5
    # half of the twist (w, along); q and -q are one rotation: the one with w > 0 is the shorter
    share = w / (abs(w) + 1e-18) * along / size
    half = c.unit_quaternion((abs(w) / size + 1.0, share * way[0], share * way[1], share * way[2]))
    turned[..., forearm, :] = _stacked(c.multiply(turn, half))


def _stacked(parts: tuple[c.Part, ...]) -> Array:
    return np.array(parts) if isinstance(parts[0], float) else np.stack(np.broadcast_arrays(*parts), axis=-1)


def _between(first: Array, second: Array, share: Array) -> Array:
    """Return rotations a share of the way between two (normalised sum: never far from the arc for a spine's turns)."""
    sign = np.where(np.sum(first * second, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    mixed = (1.0 - share) * first + share * sign * second
    return mixed / np.sqrt(np.sum(mixed * mixed, axis=-1, keepdims=True))


def _heading(turn: c.Quaternion) -> c.Quaternion:
    """Return the part of a rotation that is about the vertical."""
    w, _, y, _ = c.unit_quaternion((turn[0], 0.0 * turn[0], turn[2], 0.0 * turn[0]))
    return w, 0.0 * w, y, 0.0 * w


def _in_axes(quaternions: Array, matrix: Array) -> Array:
    """Return rotations told in other axes."""
    return np.concatenate((quaternions[..., :1], quaternions[..., 1:] @ matrix.T), axis=-1)


def _jumps(parents: IntArray) -> list[IntArray]:
    """Return for doubling distances which joint lies that far above each; past the root, and for it, the last place.

    With M_j a joint's own rotation, M_j <- M_above(j) M_j for each in turn makes M_j the product along its whole line.
    """
    count = len(parents)
    above = np.append(np.where(parents < 0, count, parents), count)
    found = []
    while np.any(above < count):
        found.append(above)
        above = above[above]
    return found


def _root_bone(rest: ArmatureRest, hips: int) -> int:
    """Return the topmost bone above the hips, -1 without one; in control rigs helpers may stand between them."""
    above = [bone for bone in rest.line(hips)[1:] if not parse_bone_name(rest.names[bone]).helper]
    if above:
        return above[-1]
    return rest.index.get("root", -1) if rest.parents[hips] >= 0 else -1


def _driven_bones(
    skeleton: Skeleton, rest: ArmatureRest, joints: dict[str, int], turns: dict[str, Array]
) -> list[_Driven]:
    """Return all bones that are turned, parents before their children."""
    driven: dict[int, _Driven] = {}
    for joint, bone in joints.items():
        index = skeleton.index(joint)
        driven[bone] = _Driven(bone, index, index, 0.0, turns[joint])
    for chain in _CHAINS:
        pins = [joint for joint in chain if joint in joints]
        for lower, upper in pairwise(pins):
            path = rest.path(joints[lower], joints[upper])
            way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(rest.heads[path], axis=0), axis=1))))
            for bone, share in zip(path[1:-1], way[1:-1] / max(float(way[-1]), 1e-9), strict=True):
                if bone not in driven and not parse_bone_name(rest.names[bone]).helper:
                    first, second = skeleton.index(lower), skeleton.index(upper)
                    driven[bone] = _Driven(bone, first, second, float(share), rot.identity())
    for joint in [side + name for side in "lr" for name in ("fingers", "toes") if side + name in joints]:
        for name in _beside(rest.names[joints[joint]]):
            bone = rest.index.get(name, -1)
            if bone >= 0 and bone not in driven:
                driven[bone] = _Driven(bone, skeleton.index(joint), skeleton.index(joint), 0.0, turns[joint])
    return [driven[bone] for bone in sorted(driven)]


def _beside(name: str) -> list[str]:
    """Return the names that the other fingers or toes have beside one: LeftHandMiddle1 -> LeftHandRing1, ..."""
    for word in _FINGERS:
        for spelling in (str, str.capitalize, str.upper):
            if spelling(word) in name:
                return [name.replace(spelling(word), spelling(other)) for other in _FINGERS if other != word]
    for word, numbers in (("finger", "2345"), ("toe", "12345")):
        at = name.lower().find(word) + len(word)
        if at >= len(word) and name[at : at + 1] in tuple(numbers):
            return [name[:at] + number + name[at + 1 :] for number in numbers if number != name[at]]
    return []


def _driven_ancestors(rest: ArmatureRest, order: Sequence[int], ancestors: IntArray | None) -> IntArray:
    """Return for each driven bone the place of the driven bone whose rotation it follows, -1 without one."""
    place = {bone: index for index, bone in enumerate(order)}
    follows = np.where(rest.inherits_rotation, rest.parents, -1) if ancestors is None else ancestors
    found = []
    for bone in order:
        above = int(follows[bone])
        while above >= 0 and above not in place:
            above = int(follows[above])
        found.append(place.get(above, -1))
    return np.array(found, dtype=np.int64)

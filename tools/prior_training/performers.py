"""Random bodies with random marker sets."""

from typing import NamedTuple

import numpy as np
from perfanim.core.body.mirroring import mirrored_skeleton
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import JOINT_NAMES, mirrored_name
from perfanim.core.geometry.arrays import Array, FloatArray, IntArray, Mask
from perfanim.core.markers.marker_set import load_marker_set

FEW, MANY = 14, 44  # number of slots for markers
# share of the performers with each set
_SMALL_SETS = {"boxing": 0.45, "locomotion": 0.2, "kendo": 0.1, "one-camera": 0.15, "two-webcams": 0.1}
_LARGE_SETS = ("cmu-41", "helen-hayes", "optitrack-baseline", "plug-in-gait")
_TORSO = tuple(
    JOINT_NAMES.index(name) for name in ("root", "lowerback", "upperback", "thorax", "lclavicle", "rclavicle")
)
LEG = [JOINT_NAMES.index(name) for name in ("ltibia", "lfoot")]  # joints whose offsets are thigh and shank
_PAIRS = np.array([JOINT_NAMES.index(min(name, mirrored_name(name))) for name in JOINT_NAMES])
_USUAL_LEG_M = 0.85

_Markers = tuple[IntArray, Array, Mask]  # joints (M,), offsets (M, 3), whether on the torso (M,)


class Performers(NamedTuple):
    """G random people, each with M slots for markers."""

    bones_m: FloatArray  # (G, J, 3) offsets of the joints
    leg_m: FloatArray  # (G,) lengths of the legs
    joints: IntArray  # (G, M) joint of each marker, 0 if a slot is empty
    offsets_m: FloatArray  # (G, M, 3) offset of each marker
    believed_bones_m: FloatArray  # bones and offsets as the solver believes them
    believed_offsets_m: FloatArray
    torso: Mask  # (G, M) markers that determine the root
    worn: Mask  # (G, M) slots that hold a marker


class PerformerMaker:
    """Draws random people.

    Args:
        skeletons: Bodies to start from.
    """

    def __init__(self, skeletons: tuple[Skeleton, ...]) -> None:
        self._bodies = [each.offsets_m for body in skeletons for each in (body, mirrored_skeleton(body))]
        self._tips = skeletons[0].tips_m
        self._sets = {name: _layout(name) for name in (*_SMALL_SETS, *_LARGE_SETS)}

    def draw(self, generator: np.random.Generator, count: int, places: int) -> Performers:
        """Return people with this many slots for markers."""
        bodies = np.array([self._body(generator) for _ in range(count)])
        joints, torso = np.zeros((count, places), dtype=np.int64), np.zeros((count, places), dtype=bool)
        offsets, worn = np.zeros((count, places, 3)), np.zeros((count, places), dtype=bool)
        for g in range(count):
            of, where, on_torso = self._markers(generator, bodies[g], places)
            order = generator.permutation(len(of))[:places]
            filled = slice(len(order))
            joints[g, filled], offsets[g, filled], torso[g, filled] = of[order], where[order], on_torso[order]
            worn[g, filled] = True
        leg = np.linalg.norm(bodies[:, LEG], axis=-1).sum(axis=-1)
        wrong = (generator.random(count) < 0.25)[:, None, None]
        believed = bodies * (1.0 + wrong * generator.normal(0.0, 0.02, bodies.shape))
        off = offsets + wrong * generator.normal(0.0, 0.006, offsets.shape)
        exact = (bodies, leg, offsets, believed, off)
        bones_m, leg_m, offsets_m, believed_m, off_m = (numbers.astype(np.float32) for numbers in exact)
        return Performers(bones_m, leg_m, joints, offsets_m, believed_m, off_m, torso, worn)

    def _body(self, generator: np.random.Generator) -> Array:
        one, other = (self._bodies[i] for i in generator.integers(len(self._bodies), size=2))
        share = generator.random() if generator.random() < 0.5 else 0.0
        body = (1.0 - share) * one + share * other
        if generator.random() < 0.3:
            return body
        lengths = generator.normal(0.0, 0.05, len(body))[_PAIRS] + generator.normal(0.0, 0.08)
        turns = generator.normal(0.0, 0.004, body.shape)
        return body * np.exp(lengths)[:, None] + turns

    def _markers(self, generator: np.random.Generator, body: Array, places: int) -> _Markers:
        kind = generator.random()
        if places > FEW:
            markers = self._sets[str(generator.choice(_LARGE_SETS))]
            kept = generator.random(len(markers[0])) < generator.uniform(0.3, 1.2)
            if kept[markers[2]].sum() < 3:
                kept |= markers[2]
            markers = _chosen(markers, kept)
        elif kind < 0.75:
            markers = self._sets[str(generator.choice(list(_SMALL_SETS), p=list(_SMALL_SETS.values())))]
            if generator.random() < 0.25:
                markers = _chosen(markers, markers[2] | (generator.random(len(markers[0])) < 0.8))
            if generator.random() < 0.25:
                further = self._anywhere(generator, generator.integers(1, 5), 0)
                markers = tuple(np.concatenate(both) for both in zip(markers, further, strict=True))
        else:
            markers = self._anywhere(generator, int(generator.integers(1, 9)), int(generator.integers(3, 6)))
        joints, offsets, torso = markers
        size = np.linalg.norm(body[LEG], axis=-1).sum() / _USUAL_LEG_M
        spread = 0.0 if generator.random() < 0.3 else generator.uniform(0.0, 0.02)
        scale = size if generator.random() < 0.5 else 1.0
        return joints, scale * offsets + generator.normal(0.0, 1.0, offsets.shape) * spread, torso

    def _anywhere(self, generator: np.random.Generator, free: int, torso: int) -> _Markers:
        """Return markers anywhere on the body: along a bone, a few centimetres off it."""
        joints = np.concatenate((generator.choice(_TORSO, torso), generator.integers(1, len(JOINT_NAMES), free)))
        along = generator.random((len(joints), 1)) * self._tips[joints]
        beside = generator.normal(size=(len(joints), 3))
        beside /= np.linalg.norm(beside, axis=-1, keepdims=True)
        reach = np.where(np.isin(joints, _TORSO), 0.13, 0.05) * generator.uniform(0.6, 1.3, len(joints))
        return joints, along + reach[:, None] * beside, np.arange(len(joints)) < torso


def _chosen(markers: _Markers, kept: Mask) -> _Markers:
    joints, offsets, torso = markers
    return joints[kept], offsets[kept], torso[kept]


def _layout(name: str) -> _Markers:
    markers = load_marker_set(name)
    joints = np.array([JOINT_NAMES.index(marker.joint) for marker in markers.markers])
    return joints, markers.offsets_m, markers.torso

"""Random bodies with random marker sets."""

from dataclasses import dataclass

import numpy as np
from perfanim.core.body.mirroring import mirrored_skeleton
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import JOINT_NAMES, mirrored_name
from perfanim.core.geometry.arrays import Array, FloatArray, IntArray, Mask
from perfanim.core.markers.marker_set import load_marker_set

FEW, MANY = 14, 44  # places for markers
_SMALL_SETS = {"boxing": 0.45, "locomotion": 0.2, "kendo": 0.1, "one-camera": 0.15, "two-webcams": 0.1}
_LARGE_SETS = ("cmu-41", "helen-hayes", "optitrack-baseline", "plug-in-gait")
_TORSO = tuple(
    JOINT_NAMES.index(name) for name in ("root", "lowerback", "upperback", "thorax", "lclavicle", "rclavicle")
)
_LEG = [JOINT_NAMES.index(name) for name in ("ltibia", "lfoot")]  # their offsets are thigh and shank
_PAIRS = np.array([JOINT_NAMES.index(min(name, mirrored_name(name))) for name in JOINT_NAMES])
_USUAL_LEG_M = 0.85


@dataclass(frozen=True)
class Performers:
    """Random people, G with M places for markers.

    Args:
        bones_m: (G, J, 3) offsets of the joints.
        leg_ratio: (G,) length of legs against those of the recorded person that each plays.
        joints: (G, M) of the markers, 0 where a place is empty.
        offsets_m: (G, M, 3).
        believed_bones_m, believed_offsets_m: what the solver takes them for.
        torso, worn: (G, M) markers that show the root, and places that hold a marker.
    """

    bones_m: FloatArray
    leg_ratio: FloatArray
    joints: IntArray
    offsets_m: FloatArray
    believed_bones_m: FloatArray
    believed_offsets_m: FloatArray
    torso: Mask
    worn: Mask


class PerformerMaker:
    """Draws random people.

    Args:
        skeletons: bodies to start from.
    """

    def __init__(self, skeletons: tuple[Skeleton, ...]) -> None:
        self._bodies = [each.offsets_m for body in skeletons for each in (body, mirrored_skeleton(body))]
        self._tips = skeletons[0].tips_m
        self._sets = {name: _layout(name) for name in (*_SMALL_SETS, *_LARGE_SETS)}

    def draw(self, generator: np.random.Generator, count: int, places: int) -> Performers:
        """Return people with so many places for markers."""
        bodies = np.array([self._body(generator) for _ in range(count)])
        joints, torso = np.zeros((count, places), dtype=np.int64), np.zeros((count, places), dtype=bool)
        offsets, worn = np.zeros((count, places, 3)), np.zeros((count, places), dtype=bool)
        for g in range(count):
            of, where, on_torso = self._markers(generator, bodies[g], places)
            order = generator.permutation(len(of))[:places]
            joints[g, : len(order)], offsets[g, : len(order)] = of[order], where[order]
            torso[g, : len(order)], worn[g, : len(order)] = on_torso[order], True
        leg = np.linalg.norm(bodies[:, _LEG], axis=-1).sum(axis=-1)
        doubt = (generator.random(count) < 0.25)[:, None, None]
        believed = bodies * (1.0 + doubt * generator.normal(0.0, 0.02, bodies.shape))
        off = offsets + doubt * generator.normal(0.0, 0.006, offsets.shape)
        parts = (bodies, leg, joints, offsets, believed, off, torso, worn)
        kinds = (np.float32, np.float32, np.int64, np.float32, np.float32, np.float32, np.bool_, np.bool_)
        return Performers(*(part.astype(kind) for part, kind in zip(parts, kinds, strict=True)))

    def _body(self, generator: np.random.Generator) -> Array:
        one, other = (self._bodies[i] for i in generator.integers(len(self._bodies), size=2))
        share = generator.random() if generator.random() < 0.5 else 0.0
        body = (1.0 - share) * one + share * other
        if generator.random() < 0.3:
            return body
        lengths = generator.normal(0.0, 0.05, len(body))[_PAIRS] + generator.normal(0.0, 0.08)
        turns = generator.normal(0.0, 0.004, body.shape)
        return body * np.exp(lengths)[:, None] + turns

    def _markers(self, generator: np.random.Generator, body: Array, places: int) -> tuple[IntArray, Array, Mask]:
        kind = generator.random()
        if places > FEW:
            joints, offsets, torso = self._sets[str(generator.choice(_LARGE_SETS))]
            kept = generator.random(len(joints)) < generator.uniform(0.3, 1.2)
            if kept[torso].sum() < 3:
                kept |= torso
            joints, offsets, torso = joints[kept], offsets[kept], torso[kept]
        elif kind < 0.75:
            name = str(generator.choice(list(_SMALL_SETS), p=list(_SMALL_SETS.values())))
            joints, offsets, torso = self._sets[name]
            if generator.random() < 0.25:
                kept = torso | (generator.random(len(joints)) < 0.8)
                joints, offsets, torso = joints[kept], offsets[kept], torso[kept]
            if generator.random() < 0.25:
                further = self._anywhere(generator, generator.integers(1, 5), 0)
                joints, offsets, torso = (
                    np.concatenate(both) for both in zip((joints, offsets, torso), further, strict=True)
                )
        else:
            joints, offsets, torso = self._anywhere(
                generator, int(generator.integers(1, 9)), int(generator.integers(3, 6))
            )
        size = np.linalg.norm(body[_LEG], axis=-1).sum() / _USUAL_LEG_M
        spread = 0.0 if generator.random() < 0.3 else generator.uniform(0.0, 0.02)
        scale = size if generator.random() < 0.5 else 1.0
        return joints, scale * offsets + generator.normal(0.0, 1.0, offsets.shape) * spread, torso

    def _anywhere(self, generator: np.random.Generator, free: int, torso: int) -> tuple[IntArray, Array, Mask]:
        """Return markers anywhere on the body: along a bone, some centimetres beside it."""
        joints = np.concatenate((generator.choice(_TORSO, torso), generator.integers(1, len(JOINT_NAMES), free)))
        along = generator.random((len(joints), 1)) * self._tips[joints]
        beside = generator.normal(size=(len(joints), 3))
        beside /= np.linalg.norm(beside, axis=-1, keepdims=True)
        on_torso = np.isin(joints, _TORSO)
        reach = np.where(on_torso, 0.13, 0.05) * generator.uniform(0.6, 1.3, len(joints))
        shows = np.arange(len(joints)) < torso
        return joints, along + reach[:, None] * beside, shows


def _layout(name: str) -> tuple[IntArray, Array, Mask]:
    markers = load_marker_set(name)
    joints = np.array([JOINT_NAMES.index(marker.joint) for marker in markers.markers])
    return joints, markers.offsets_m, markers.torso

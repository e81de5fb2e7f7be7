"""Bodies of many proportions: performers, and prototypes for subject calibration."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import JOINT_NAMES, default_skeleton, scaled

from .proportions import Array, Body

# standard deviations of a segment's share of the height between people of the same height
_SPREAD = {"leg": 0.025, "trunk": 0.020, "neck": 0.035, "arm": 0.025, "shoulder": 0.035, "hip": 0.045, "foot": 0.030}
_PART_SPREAD = {"foot": 0.018, "wrist": 0.018, "hand": 0.018}  # of a part's share of its limb
_SIDE_SPREAD = 0.006  # of the difference between left and right limbs
_BROAD = {"shoulder": 0.07, "hip": 0.09}  # relative additional length for a broad build
_JOINTS = {
    "leg": "tibia foot", "trunk": "upperback thorax lowerneck clavicle", "neck": "upperneck head",
    "arm": "radius wrist hand fingers thumb", "shoulder": "humerus", "hip": "femur", "foot": "toes",
}  # fmt: skip
_GROUP_OF = {
    side + name: group for group, names in _JOINTS.items() for name in names.split() for side in ("", "l", "r")
}


def body(height_m: float = 1.75, build: float = 0.0, seed: int = 0) -> Skeleton:
    """Return a person's standard skeleton, with human variation of proportions.

    Args:
        height_m: Head to sole.
        build: -1 slender .. 1 broad.
        seed: Number of the person with this height and build; 0 has average proportions.
    """
    plain = default_skeleton(height_m)
    shape = scaled(plain, _factors(build, np.random.default_rng(seed) if seed else None))
    # a bone is the offset of the joint at its end; bones without one (head, toes, fingers) are named by their own joint
    tips = shape.tips_m.copy()
    for joint in range(1, len(shape)):
        parent = int(shape.parents[joint])
        if np.allclose(plain.tips_m[parent], plain.offsets_m[joint]):
            tips[parent] = shape.offsets_m[joint]
    whole = replace(shape, tips_m=tips)
    return scaled(whole, _stature(plain) / _stature(whole))


def _factors(build: float, rng: np.random.Generator | None) -> Array:
    """Return one factor per joint offset."""
    groups = {name: 1.0 + build * _BROAD.get(name, 0.0) for name in _SPREAD}
    parts = dict.fromkeys(_PART_SPREAD, 1.0)
    sides = {"l": 1.0, "r": 1.0}
    if rng is not None:

        def draw(spread: float) -> float:
            return spread * float(np.clip(rng.standard_normal(), -2.0, 2.0))

        groups = {name: value * (1.0 + draw(_SPREAD[name])) for name, value in groups.items()}
        parts = {name: 1.0 + draw(spread) for name, spread in _PART_SPREAD.items()}
        parts["thumb"] = parts["hand"]  # both begin where the forearm ends
        uneven = draw(0.5 * _SIDE_SPREAD)
        sides = {"l": 1.0 + uneven, "r": 1.0 - uneven}
    result = np.ones(len(JOINT_NAMES))
    for i, name in enumerate(JOINT_NAMES):
        if group := _GROUP_OF.get(name):
            result[i] = groups[group] * parts.get(name[1:], 1.0) * (sides[name[0]] if group in ("arm", "leg") else 1.0)
    return result


def _stature(skeleton: Skeleton) -> float:
    """Return the height of the end of the head above the ground, standing."""
    head = skeleton.index("head")
    return float(Body(skeleton).standing_m + skeleton.rest_positions_m[head, 1] + skeleton.tips_m[head, 1])


def prototype_bodies(count: int = 24) -> tuple[Skeleton, ...]:
    """Return bodies that cover the sizes and builds of adults, for subject calibration."""
    heights = np.linspace(1.48, 2.02, count)
    return tuple(body(float(height), (-0.8, 0.0, 0.8)[i % 3], 100 + i) for i, height in enumerate(heights))


def save_bodies(bodies: tuple[Skeleton, ...], path: Path) -> None:
    """Write standard skeletons as JSON: offsets and bone ends in metres."""
    rows = [
        {
            "height_m": round(_stature(skeleton), 4),
            "offsets_m": np.round(skeleton.offsets_m, 5).tolist(),
            "tips_m": np.round(skeleton.tips_m, 5).tolist(),
        }
        for skeleton in bodies
    ]
    text = ",\n  ".join(json.dumps(row, separators=(",", ":")) for row in rows)
    joints = json.dumps(list(JOINT_NAMES))
    path.write_text(f'{{"version": 1, "joints": {joints}, "skeletons": [\n  {text}\n]}}\n', encoding="utf-8")

"""Bodies of many proportions: performers, and prototypes of subject calibration."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import JOINT_NAMES, default_skeleton, scaled
from perfanim.core.errors import SettingsError
from perfanim.core.system.files import atomic_path

from .proportions import Body

Array = NDArray[np.float64]

PROTOTYPES = 24
_HEIGHTS_M = (1.48, 2.02)
_DECIMALS = 5  # of metres in the file: a hundredth of a millimetre
# how much people of one height differ: one standard deviation of a segment's share of the height
_SPREAD = {"leg": 0.025, "trunk": 0.020, "neck": 0.035, "arm": 0.025, "shoulder": 0.035, "hip": 0.045, "foot": 0.030}
_SHANK_SPREAD, _FOREARM_SPREAD, _SIDE_SPREAD = 0.018, 0.018, 0.006
# what a broad build adds to shoulders, hips, and takes from nothing else
_BROAD = {"shoulder": 0.07, "hip": 0.09}

_GROUPS: dict[str, str] = (
    {name: "leg" for side in "lr" for name in (f"{side}tibia", f"{side}foot")}
    | dict.fromkeys(("upperback", "thorax", "lowerneck", "lclavicle", "rclavicle"), "trunk")
    | dict.fromkeys(("upperneck", "head"), "neck")
    | {f"{side}{name}": "arm" for side in "lr" for name in ("radius", "wrist", "hand", "fingers", "thumb")}
    | {f"{side}humerus": "shoulder" for side in "lr"}
    | {f"{side}femur": "hip" for side in "lr"}
    | {f"{side}toes": "foot" for side in "lr"}
)
_PAIRED = {"foot": _SHANK_SPREAD, "wrist": _FOREARM_SPREAD, "hand": _FOREARM_SPREAD}


def body(height_m: float = 1.75, build: float = 0.0, seed: int = 0) -> Skeleton:
    """Return a person's standard skeleton, with human variation of proportions.

    Args:
        height_m: head to sole.
        build: -1 slender .. 1 broad.
        seed: which person of this height and build; 0 has average proportions.

    Raises:
        SettingsError: a height or build that people do not have.
    """
    if not 1.2 <= height_m <= 2.3:
        raise SettingsError(f"a height of {height_m} m is outside 1.2..2.3 m")
    if not -2.0 <= build <= 2.0:
        raise SettingsError(f"a build of {build} is outside -2..2")
    plain = default_skeleton(height_m)
    factors = _factors(build, np.random.default_rng(seed) if seed else None)
    # a bone is the offset of the joint at its end; bones without one (head, toes, fingers) go by their own joint
    shape = scaled(plain, factors)
    tips = shape.tips_m.copy()
    for joint in range(1, len(shape)):
        parent = int(shape.parents[joint])
        if np.allclose(plain.tips_m[parent], plain.offsets_m[joint]):
            tips[parent] = shape.offsets_m[joint]
    whole = Skeleton(shape.names, shape.parents, shape.offsets_m, tips, shape.angle_axes, shape.angle_orders)
    return scaled(whole, _stature(plain) / _stature(whole))


def _factors(build: float, rng: np.random.Generator | None) -> Array:
    """Return one factor per joint's offset."""
    groups = {name: 1.0 + build * _BROAD.get(name, 0.0) for name in _SPREAD}
    parts = dict.fromkeys(_PAIRED, 1.0)
    sides = {"l": 1.0, "r": 1.0}
    if rng is not None:
        groups = {name: value * (1.0 + _SPREAD[name] * _draw(rng)) for name, value in groups.items()}
        parts = {name: 1.0 + spread * _draw(rng) for name, spread in _PAIRED.items()}
        parts["thumb"] = parts["hand"]  # both begin where the forearm ends
        uneven = 0.5 * _SIDE_SPREAD * _draw(rng)
        sides = {"l": 1.0 + uneven, "r": 1.0 - uneven}
    result = np.ones(len(JOINT_NAMES))
    for i, name in enumerate(JOINT_NAMES):
        if name in _GROUPS:
            result[i] = groups[_GROUPS[name]] * parts.get(name[1:], 1.0)
            if _GROUPS[name] in ("arm", "leg"):
                result[i] *= sides[name[0]]
    return result


def _draw(rng: np.random.Generator) -> float:
    return float(np.clip(rng.standard_normal(), -2.0, 2.0))


def _stature(skeleton: Skeleton) -> float:
    """Return the height of the head's end above the ground, standing."""
    head = skeleton.index("head")
    return float(Body(skeleton).standing_m + skeleton.rest_positions_m[head, 1] + skeleton.tips_m[head, 1])


def prototype_bodies(count: int = PROTOTYPES) -> tuple[Skeleton, ...]:
    """Return bodies that span the sizes and builds of adults, for subject calibration."""
    heights = np.linspace(*_HEIGHTS_M, count)
    builds = (-0.8, 0.0, 0.8)
    return tuple(body(float(height), builds[i % len(builds)], 100 + i) for i, height in enumerate(heights))


def save_bodies(bodies: tuple[Skeleton, ...], path: Path | str) -> None:
    """Write standard skeletons as JSON: offsets and bone ends in metres."""
    rows = [
        {
            "height_m": round(_stature(skeleton), 4),
            "offsets_m": np.round(skeleton.offsets_m, _DECIMALS).tolist(),
            "tips_m": np.round(skeleton.tips_m, _DECIMALS).tolist(),
        }
        for skeleton in bodies
    ]
    text = ",\n  ".join(json.dumps(row, separators=(",", ":")) for row in rows)
    joints = json.dumps(list(JOINT_NAMES))
    with atomic_path(Path(path)) as temporary:
        temporary.write_text(f'{{"version": 1, "joints": {joints}, "skeletons": [\n  {text}\n]}}\n', encoding="utf-8")

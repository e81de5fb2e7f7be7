"""Presets for fingers: the same hand on skeletons with any axes, any rest pose and any number of finger bones."""

import numpy as np
import pytest
from perfanim.core.errors import CharacterError
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.armature_rest import ArmatureRest
from perfanim.core.retarget.hand_poses import HAND_POSES, finger_turns

FINGERS = ("Index", "Middle", "Ring", "Pinky")
BONES = {"lhand": "LeftHand", "lfingers": "LeftHandMiddle1", "lthumb": "LeftHandThumb1"}
BONES |= {joint.replace("l", "r", 1): bone.replace("Left", "Right") for joint, bone in BONES.items()}
LENGTH_M = 0.03


def hands(bent_deg: float = 0.0, phalanges: int = 3, seed: int = 0) -> ArmatureRest:
    """Two hands of a T pose, palms down, z up, facing -y; fingers bent at rest, bones with random axes."""
    random = np.random.default_rng(seed)
    names, parents, heads, tails = [], [], [], []

    def add(name: str, parent: int, head: np.ndarray, tail: np.ndarray) -> int:
        for values, value in zip((names, parents, heads, tails), (name, parent, head, tail), strict=True):
            values.append(value)
        return len(names) - 1

    for side, out in (("Left", 1.0), ("Right", -1.0)):
        wrist = np.array([0.7 * out, 0.0, 1.4])
        knuckle = wrist + np.array([0.1 * out, 0.0, 0.0])
        hand = add(f"{side}Hand", -1, wrist, knuckle)
        for row, finger in enumerate(FINGERS):
            above, at = hand, knuckle + np.array([0.0, -0.03 + 0.02 * row, 0.0])
            for number in range(1, phalanges + 1):
                angle = np.radians(bent_deg) * number
                end = at + LENGTH_M * np.array([out * np.cos(angle), 0.0, -np.sin(angle)])
                above, at = add(f"{side}Hand{finger}{number}", above, at, end), end
        above, at = hand, wrist + np.array([0.03 * out, -0.03, 0.0])
        for number in range(1, 4):
            end = at + LENGTH_M * np.array([0.7 * out, -0.7, 0.0])
            above, at = add(f"{side}HandThumb{number}", above, at, end), end
    count = len(names)
    axes = rot.to_matrix(rot.normalize(random.normal(size=(count, 4))))
    flags = np.ones(count, dtype=np.bool_)
    where = np.array(parents), np.array(heads), np.array(tails)
    return ArmatureRest(tuple(names), where[0], where[1], where[2], axes, flags, flags, flags, np.ones(count), ~flags)


def posed(rest: ArmatureRest, turns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the direction of each bone in armature space, as Blender poses bones."""
    world: list[np.ndarray] = []
    for bone, name in enumerate(rest.names):
        own = rest.axes[bone] @ rot.to_matrix(turns.get(name, rot.identity())) @ rest.axes[bone].T
        above = int(rest.parents[bone])
        world.append(own if above < 0 else world[above] @ own)
    ways = (rest.tails - rest.heads) / LENGTH_M
    return {name: turn @ way for name, turn, way in zip(rest.names, world, ways, strict=True)}


def pose(rest: ArmatureRest, name: str) -> dict[str, np.ndarray]:
    turns = finger_turns(rest, BONES, "l", HAND_POSES[name]) | finger_turns(rest, BONES, "r", HAND_POSES[name])
    return posed(rest, turns)


@pytest.mark.parametrize("bent_deg", [0.0, 20.0])
def test_fingers_are_as_flat_and_as_bent_as_asked_whatever_the_rest_pose(bent_deg: float) -> None:
    rest = hands(bent_deg)
    for out, side in ((1.0, "Left"), (-1.0, "Right")):
        flat, fist = pose(rest, "flat"), pose(rest, "fist")
        for finger in FINGERS:
            for number in (1, 2, 3):
                np.testing.assert_allclose(flat[f"{side}Hand{finger}{number}"], [out, 0.0, 0.0], atol=1e-6)
            asked = np.radians(75.0 + 95.0 + 60.0), np.radians(85.0 + 95.0 + 60.0)
            bent = np.arctan2(-fist[f"{side}Hand{finger}3"][2], out * fist[f"{side}Hand{finger}3"][0]) % (2 * np.pi)
            assert asked[0] - 1e-6 <= bent <= asked[1] + 1e-6


def test_pointing_bends_all_fingers_but_the_index() -> None:
    shown = pose(hands(), "point")
    assert shown["LeftHandIndex3"][0] > np.cos(np.radians(16.0))
    for finger in FINGERS[1:]:
        assert shown[f"LeftHand{finger}2"][0] < -0.9


def test_the_thumb_of_a_fist_lies_across_the_palm() -> None:
    for name, out in (("LeftHandThumb3", 1.0), ("RightHandThumb3", -1.0)):
        way = pose(hands(), "fist")[name]
        assert way[1] > 0.3  # towards the little finger
        assert way[2] < -0.3  # in front of the palm
        assert out * way[0] > -0.8
        np.testing.assert_allclose(pose(hands(), "flat")[name][1], -0.7, atol=1e-6)  # stays as it is at rest


def test_stiff_fingers_bend_less_than_their_joints_would() -> None:
    fist, relaxed = (pose(hands(phalanges=1), name)["LeftHandMiddle1"] for name in ("fist", "relaxed"))
    np.testing.assert_allclose(fist, [0.0, 0.0, -1.0], atol=1e-6)
    assert 0.7 < relaxed[0] < 0.95


def test_a_hand_without_mapped_fingers_is_refused() -> None:
    with pytest.raises(CharacterError, match="no bones of the right hand's fingers and thumb are mapped"):
        finger_turns(hands(), {"rhand": "RightHand"}, "r", HAND_POSES["fist"])

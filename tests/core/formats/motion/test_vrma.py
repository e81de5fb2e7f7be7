"""VRM animations, read here by what the specifications of glTF and of the extension say."""

import json
import struct

import numpy as np
import pytest
from perfanim.core.body.motion import resampled, sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standing_on_floor import on_floor
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.motion.write_motion import write_motion
from perfanim.core.formats.vmc.humanoid import BONES
from perfanim.core.geometry import rotations as rot
from perfanim.core.system.assets import MOTION

# of https://github.com/vrm-c/vrm-specification, VRMC_vrm-1.0/humanoid.md
REQUIRED = {
    "hips", "spine", "head",
    *(
        side + bone
        for side in ("left", "right")
        for bone in ("UpperLeg", "LowerLeg", "Foot", "UpperArm", "LowerArm", "Hand")
    ),
}  # fmt: skip
JOINTS = {bone[0].lower() + bone[1:]: joint for bone, (joint, _) in BONES.items()}
SIZES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def read(path):
    """Return the document and a function from an accessor to its numbers."""
    data = path.read_bytes()
    assert struct.unpack("<4sII", data[:12]) == (b"glTF", 2, len(data))
    chunks, at = {}, 12
    while at < len(data):
        size, kind = struct.unpack("<I4s", data[at : at + 8])
        assert size % 4 == 0
        chunks[kind] = data[at + 8 : at + 8 + size]
        at += 8 + size
    assert list(chunks) == [b"JSON", b"BIN\0"]
    document = json.loads(chunks[b"JSON"])
    assert document["buffers"] == [{"byteLength": len(chunks[b"BIN\0"])}]

    def numbers(index):
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126
        assert view["byteOffset"] % 4 == 0
        assert view["byteLength"] == 4 * SIZES[accessor["type"]] * accessor["count"]
        assert view["byteOffset"] + view["byteLength"] <= len(chunks[b"BIN\0"])
        raw = chunks[b"BIN\0"][view["byteOffset"] :][: view["byteLength"]]
        return np.frombuffer(raw, "<f4").reshape(accessor["count"], -1).astype(float)

    return document, numbers


@pytest.fixture
def written(truth, tmp_path):
    write_motion(truth, tmp_path / "walk.vrma")
    return read(tmp_path / "walk.vrma")


def test_it_is_a_vrm_animation_as_specified(written, truth):
    document, numbers = written
    assert document["asset"]["version"] == "2.0"
    assert document["extensionsUsed"] == ["VRMC_vrm_animation"]
    extension = document["extensions"]["VRMC_vrm_animation"]
    assert extension["specVersion"] == "1.0"
    bones = {bone: entry["node"] for bone, entry in extension["humanoid"]["humanBones"].items()}
    assert set(bones) >= REQUIRED
    assert not {"leftEye", "rightEye"} & set(bones)
    assert len(set(bones.values())) == len(bones)
    nodes = document["nodes"]
    assert not any("scale" in node or "matrix" in node for node in nodes)
    children = [child for node in nodes for child in node.get("children", [])]
    assert sorted([*children, *document["scenes"][document["scene"]]["nodes"]]) == list(range(len(nodes)))
    (animation,) = document["animations"]
    targets = [(channel["target"]["node"], channel["target"]["path"]) for channel in animation["channels"]]
    assert len(set(targets)) == len(targets)
    assert {node for node, path in targets if path == "translation"} == {bones["hips"]}  # of no other bone
    assert {path for _, path in targets} == {"translation", "rotation"}
    assert {node for node, path in targets if path == "rotation"} == set(bones.values())
    for sampler in animation["samplers"]:
        assert sampler["interpolation"] == "LINEAR"
        times = numbers(sampler["input"])[:, 0]
        bounds = document["accessors"][sampler["input"]]
        assert (bounds["min"], bounds["max"]) == ([times.min()], [times.max()])
        np.testing.assert_allclose(times, np.arange(truth.frames) / 30.0, atol=1e-6)
        assert document["accessors"][sampler["output"]]["count"] == len(times)


def places(document, numbers, frame):
    """World positions of the bones by name; of the rest pose for None."""
    local = {}
    for number, node in enumerate(document["nodes"]):
        local[number] = [np.array(node.get("translation", (0, 0, 0))), np.array([1.0, 0, 0, 0])]
    animation = document["animations"][0]
    for channel in animation["channels"] if frame is not None else []:
        value = numbers(animation["samplers"][channel["sampler"]]["output"])[frame]
        node = channel["target"]["node"]
        if channel["target"]["path"] == "translation":
            local[node][0] = value
        else:
            assert np.linalg.norm(value) == pytest.approx(1.0, abs=1e-6)
            local[node][1] = value[[3, 0, 1, 2]]
    found = {}

    def walk(node, place, turn):
        own = place + rot.rotate(turn, local[node][0])
        found[document["nodes"][node]["name"]] = own
        for child in document["nodes"][node].get("children", []):
            walk(child, own, rot.multiply(turn, local[node][1]))

    walk(document["scenes"][0]["nodes"][0], np.zeros(3), np.array([1.0, 0, 0, 0]))
    return found


def test_its_rest_pose_is_the_t_pose(written):
    found = places(*written, None)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for arm, end in (("UpperArm", "LowerArm"), ("LowerArm", "Hand")):
            bone = found[side + end] - found[side + arm]
            assert bone / np.linalg.norm(bone) == pytest.approx([sign, 0.0, 0.0], abs=0.02)
        for leg, end in (("UpperLeg", "LowerLeg"), ("LowerLeg", "Foot")):
            bone = found[side + end] - found[side + leg]
            assert bone / np.linalg.norm(bone) == pytest.approx([0.0, -1.0, 0.0], abs=0.02)
        assert found[side + "Toes"][2] > found[side + "Foot"][2] + 0.05  # it looks along z
        assert 0.0 < found[side + "Toes"][1] < 0.1  # and stands on the floor


def test_the_bones_are_where_the_joints_are(written, truth):
    positions, _ = forward_kinematics(truth.skeleton, truth.rotations, truth.root_positions_m)
    for frame in range(0, truth.frames, 7):
        found = places(*written, frame)
        for bone, joint in JOINTS.items():
            if bone != "head":  # it hangs on a second joint of the neck, which humanoids lack
                assert found[bone] == pytest.approx(positions[frame, truth.skeleton.index(joint)], abs=1e-5), bone


def test_the_motion_and_the_rest_pose_stand_on_the_same_floor(tmp_path):
    """Programs move an avatar's hips relative to the rest pose's: its soles are as far off as the two differ."""
    write_motion(on_floor(sliced(read_motion(MOTION / "boxing-01-neutral.bvh"), 0, 90)), tmp_path / "box.vrma")
    document, numbers = read(tmp_path / "box.vrma")

    def lowest_m(frame):
        found = places(document, numbers, frame)
        return min(found[side + "Toes"][1] for side in ("left", "right"))

    assert np.median([lowest_m(frame) for frame in range(0, 90, 6)]) == pytest.approx(lowest_m(None), abs=0.002)


def test_neighbouring_quaternions_lie_in_one_hemisphere_and_the_rate_can_be_another(truth, tmp_path):
    assert write_motion(truth, tmp_path / "walk.vrma", rate=15.0).fps == 15.0
    document, numbers = read(tmp_path / "walk.vrma")
    animation = document["animations"][0]
    assert len(numbers(animation["samplers"][0]["input"])) == resampled(truth, 15.0).frames
    for channel in animation["channels"]:
        values = numbers(animation["samplers"][channel["sampler"]]["output"])
        if channel["target"]["path"] == "rotation":
            assert np.all(np.sum(values[1:] * values[:-1], axis=1) > 0.0)

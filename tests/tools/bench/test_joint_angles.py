"""The benchmark of joint angles, on shipped clips that stand in for people's."""

import pytest
from bench.joint_angles import joint_angles
from bench.run import Run
from perfanim.core.body.motion import sliced
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry import rotations as rot


def test_what_people_do_otherwise_is_found(embedded_motion, tmp_path):
    folder = tmp_path / "cmu"
    folder.mkdir()
    clips = (("07_01", "walking-01-neutral"), ("08_01", "walking-03-relaxed"), ("16_16", "running-01-brisk"))
    for trial, name in clips:
        walk = sliced(embedded_motion[name], 60, 180)
        elbow = walk.skeleton.index("lradius")
        hinge = rot.to_rotation_vector(walk.rotations[60, elbow])
        more = rot.from_rotation_vector(1.0 * hinge / (hinge @ hinge) ** 0.5)  # a radian
        walk.rotations[:, elbow] = rot.multiply(walk.rotations[:, elbow], more)
        walk.rotations[:, walk.skeleton.index("rthumb")] = [1.0, 0.0, 0.0, 0.0]
        write_bvh(walk, folder / f"{trial}.bvh")
    (folder / "index.tsv").write_text(
        "trial\tdescription\n07_01\twalk\n08_01\tslow walk\n16_16\twalk\n", encoding="utf-8"
    )
    found = joint_angles(Run(tmp_path, tmp_path / "out"))
    assert found["people"] == {"walking": ["07", "08"]}  # 16_16 is a test take
    first, *others = found["rows"]
    assert (first["joint"], first["axis"]) == ("lradius", "X")
    assert first["people_deg"] - first["ours_deg"] == pytest.approx(57.3, abs=12.0)  # the styles differ by 8 degrees
    assert first["outside_deg"] > 20.0 > 2.0 * max(row["outside_deg"] for row in others)
    assert "rthumb" not in {row["joint"] for row in found["rows"]}

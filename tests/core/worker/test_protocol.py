from dataclasses import fields, replace

import numpy as np
import pytest
from perfanim.core.body.body_parts import PARTS
from perfanim.core.body.pose_notes import PoseNote, source_notes
from perfanim.core.body.scene_pose import PerformerPose, PropPose, ScenePose
from perfanim.core.errors import CaptureError
from perfanim.core.formats.take_file.pose_codec import TimedPose, pack_pose, pack_solved, unpack_pose
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_frame_codec import unpack_stamped
from perfanim.core.worker.protocol import Decoder, Message, MessageKind, encode, encode_frame, encode_json


def a_frame(number: int) -> MarkerFrame:
    rng = np.random.default_rng(number)
    points = rng.normal(size=(5, 3))
    return MarkerFrame(number, number / 60, points, np.tile(np.eye(3) * 1e-6, (5, 1, 1)), notes=("left hand hidden",))


@pytest.mark.parametrize("piece", [1, 7, 64, 10_000])
def test_messages_survive_any_cutting(piece: int) -> None:
    stream = b"".join(
        [
            encode_json(MessageKind.HELLO, {"token": "t", "n": np.int64(4)}),
            *[encode_frame(10.0 + i, a_frame(i)) for i in range(3)],
            encode(MessageKind.END),
        ]
    )
    decoder = Decoder()
    messages: list[Message] = []
    for start in range(0, len(stream), piece):
        messages += decoder.feed(stream[start : start + piece])
    assert [m.kind for m in messages] == [MessageKind.HELLO, *[MessageKind.FRAME] * 3, MessageKind.END]
    assert messages[0].json() == {"token": "t", "n": 4}
    for i, message in enumerate(messages[1:4]):
        stamp, frame = unpack_stamped(message.payload)
        assert stamp == 10.0 + i
        assert frame.number == i
        assert frame.notes == ("left hand hidden",)
        np.testing.assert_array_equal(frame.points_m, a_frame(i).points_m)


def a_pose(seed: int) -> PerformerPose:
    rng = np.random.default_rng(seed)
    return PerformerPose(
        number=7,
        time_s=0.125,
        rotations=rng.normal(size=(29, 4)),
        root_position_m=rng.normal(size=3),
        confidence=0.75,
        markers_m=rng.normal(size=(9, 3)),
        observed_m=np.vstack((rng.normal(size=(8, 3)), np.full((1, 3), np.nan))),
        single_cameras=np.arange(9) - 1,
        marker_rms_m=float("nan"),
        neighbours=64,
        dimensions=7,
        notes=(PoseNote.hidden(["LHND"]), *source_notes(["slow"])),
    )


def assert_same(one: object, other: object) -> None:
    for field in fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), field.name)


@pytest.mark.parametrize(("props", "others", "version"), [(0, 0, 1), (2, 0, 2), (0, 1, 3), (2, 2, 3)])
def test_poses_travel_whole(props: int, others: int, version: int) -> None:
    rng = np.random.default_rng(1)
    pose = ScenePose(
        tuple(a_pose(1 + n) for n in range(1 + others)),
        tuple(PropPose(rng.normal(size=4), rng.normal(size=3), 0.001 * n, 3 * n) for n in range(props)),
        a_pose(1).notes,
    )
    (message,) = Decoder().feed(encode(MessageKind.POSE, pack_solved(TimedPose(pose, 12.5, 0.004, 3))))
    solved = message.pose()
    assert (solved.stamp_s, solved.solve_s, solved.waiting) == (12.5, 0.004, 3)
    assert (len(solved.pose.props), len(solved.pose.performers)) == (props, 1 + others)
    for mine, other in zip(solved.pose.props + solved.pose.performers, pose.props + pose.performers, strict=True):
        assert_same(mine, other)
    assert (solved.pose.notes, solved.pose.number, solved.pose.time_s) == (pose.notes, pose.number, pose.time_s)
    data = pack_pose(pose)
    assert data[4] == version  # what knows no further targets can read a pose without any
    for broken in (data[:-1], data[:20], b"XXXX" + data[4:], data + b"x"):
        with pytest.raises(CaptureError):
            unpack_pose(broken)


@pytest.mark.parametrize("known", [(True,), (True, False), (False, True)])
def test_errors_of_parts_travel_with_poses(known: tuple[bool, ...]) -> None:
    errors_deg = np.linspace(1.0, 40.0, len(PARTS)).astype(np.float32).astype(np.float64)
    performers = [a_pose(n) for n in range(len(known))]
    sure = [replace(pose, part_errors_deg=errors_deg) if k else pose for pose, k in zip(performers, known, strict=True)]
    data = pack_pose(ScenePose(tuple(sure), (), performers[0].notes))
    for mine, other in zip(unpack_pose(data).performers, sure, strict=True):
        np.testing.assert_array_equal(mine.part_errors_deg, other.part_errors_deg)
        assert_same(replace(mine, notes=other.notes), other)
    for broken in (data[:-1], data[:8], data[:-4], data + b"x"):
        with pytest.raises(CaptureError):
            unpack_pose(broken)


def test_a_damaged_stream_is_refused() -> None:
    good = encode_json(MessageKind.STATUS, {"activity": "x"})
    for position, value in ((0, 0), (2, 99), (3, 77), (7, 255)):
        damaged = bytearray(good)
        damaged[position] = value
        with pytest.raises(CaptureError):
            Decoder().feed(bytes(damaged))


def test_control_messages_must_be_objects() -> None:
    with pytest.raises(CaptureError, match="not JSON"):
        Message(MessageKind.STATUS, b"\xff{").json()
    with pytest.raises(CaptureError, match="not a JSON object"):
        Message(MessageKind.STATUS, b"[1]").json()

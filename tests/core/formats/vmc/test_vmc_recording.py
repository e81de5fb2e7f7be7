"""Packets of any layout made into motion and marker takes, and the way over the network."""

import numpy as np
import pytest
from osc_frames import frame_packet, message
from perfanim.core.body.motion import resampled, sliced
from perfanim.core.errors import CaptureError, TakeError
from perfanim.core.formats.vmc.frame_assembler import LIMITS
from perfanim.core.formats.vmc.humanoid import bone_poses, motion_of_bones
from perfanim.core.formats.vmc.vmc_packets import BONE, ROOT, TIME
from perfanim.core.formats.vmc.vmc_recording import Recording
from perfanim.core.formats.vmc.vmc_udp import Receiver, play, record
from perfanim.core.geometry import rotations as rot
from trackers_sent import tracker_packet

QUIET = lambda *_: None  # noqa: E731


def packets_of(motion):
    poses = bone_poses(motion)
    frames = zip(poses.positions_m, poses.rotations, strict=True)
    return [frame_packet(at / motion.fps, poses.names, *frame) for at, frame in enumerate(frames)]


def test_a_motion_over_the_network_and_back(truth):
    motion = sliced(resampled(truth, 120.0), 0, 40)
    with Receiver(0) as receiver:
        sent = play(motion, "127.0.0.1", receiver.port, QUIET)
        packets = []
        while (packet := receiver.receive(0.0)) is not None:  # they lie in the socket's buffer
            packets.append(packet)
    assert sent == sum(map(len, packets))
    recording = Recording()
    for packet in packets:
        recording.add(packet, 0.0)
    again, received = recording.motion("again")
    assert (received, recording.gathering.packets, recording.gathering.malformed) == (40, 40, 0)
    assert (again.frames, again.fps) == (40, 120.0)
    expected, found = bone_poses(motion), bone_poses(again)
    forearms = [found.names.index(side + "LowerArm") for side in ("Left", "Right")]
    hands = [found.names.index(side + "Hand") for side in ("Left", "Right")]
    others = [at for at in range(len(found.names)) if at not in (*forearms, *hands)]
    assert rot.angle_between(expected.rotations[:, others], found.rotations[:, others]).max() < 1e-5
    # a turn of the forearm goes to the wrist, and with it to the hand: both together are as they were
    both = [rot.multiply(p.rotations[:, forearms], p.rotations[:, hands]) for p in (expected, found)]
    assert rot.angle_between(*both).max() < 1e-5
    assert np.abs(expected.positions_m - found.positions_m).max() < 1e-5


def test_record_ends_by_itself_and_keeps_what_lies_in_the_buffer(truth):
    packets = packets_of(sliced(truth, 0, 5))
    with Receiver(0) as receiver:
        play(sliced(truth, 0, 5), "127.0.0.1", receiver.port, QUIET)
        told = []
        recording = record(receiver, 0.01, lambda fraction, text: told.append((fraction, text)))
    assert recording.gathering.packets == len(packets)
    assert told[0] == (0.0, f"listening on port {receiver.port}")


def test_a_port_that_is_taken_and_a_host_that_is_not_there_are_told(truth):
    with Receiver(0) as receiver, pytest.raises(CaptureError, match=f"port {receiver.port}: cannot be opened"):
        Receiver(receiver.port)
    with pytest.raises(CaptureError, match="cannot be reached"):
        play(truth, "bad host name", 39539, QUIET)


def test_lost_and_malformed_packets(truth):
    motion = sliced(truth, 0, 12)
    recording = Recording()
    for at, packet in enumerate(packets_of(motion)):
        if at not in (4, 5):
            recording.add(packet, 0.0)
        recording.add(b"noise", 0.0)
    again, received = recording.motion("again")
    assert (received, recording.gathering.malformed, again.frames) == (10, 12, 12)
    kept = [at for at in range(12) if at not in (4, 5)]
    expected = motion_of_bones(bone_poses(motion), "all", motion.fps)
    assert rot.angle_between(again.rotations[kept], expected.rotations[kept]).max() < 1e-5
    assert again.root_positions_m[[4, 5]] == pytest.approx(motion.root_positions_m[[4, 5]], abs=0.002)


def test_a_frame_may_come_in_single_messages_without_a_clock_and_leave_bones_out(truth):
    motion = sliced(truth, 0, 6)
    poses = bone_poses(motion)
    turn = np.sqrt(0.5)
    recording = Recording()
    for frame in range(motion.frames):
        arrival_s = 10.0 + frame / 30
        recording.add(message(ROOT, "root", 1.0, 0.0, 0.0, 0.0, turn, 0.0, turn), arrival_s)
        for at, name in enumerate(poses.names):
            if name == "Head" and frame in (0, 3):
                continue
            w, x, y, z = poses.rotations[frame, at] * [1, 1, -1, -1]
            position = poses.positions_m[frame, at] * [-1, 1, 1]
            recording.add(message(BONE, name, *map(float, (*position, x, y, z, w))), arrival_s)
    again, received = recording.motion("again")
    assert (received, again.frames, again.fps) == (6, 6, 30.0)
    # Unity's quarter turn about y takes forward to the right: ours (x left) to -x
    x, y, z = motion.root_positions_m.T
    assert again.root_positions_m == pytest.approx(np.stack((-z - 1.0, y, x), axis=-1), abs=1e-5)
    head = bone_poses(again).names.index("Head")
    turns = bone_poses(again).rotations[:, head]
    expected = poses.rotations[[1, 1, 2, 2, 4, 5], head]
    assert rot.angle_between(turns, expected).max() < 1e-5


@pytest.mark.parametrize("jump_s", [-3.0, 1e6, 3e38])
def test_a_clock_that_jumps_is_not_believed(truth, jump_s):
    poses = bone_poses(sliced(truth, 0, 8))
    recording = Recording()
    for at in range(8):
        time_s = at / 30 + (jump_s if at > 4 else 0.0)
        packet = frame_packet(time_s, poses.names, poses.positions_m[at], poses.rotations[at])
        recording.add(packet, at / 60)
    motion, received = recording.motion("jumped")
    assert (motion.frames, received, motion.fps) == (8, 8, 60.0)


def test_frames_a_year_apart_are_refused():
    recording = Recording()
    for arrival_s in (0.0, 1.0, 2.0, 3e7):
        recording.add(message("/VMC/Ext/Tra/Pos", "waist", 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0), arrival_s)
    with pytest.raises(TakeError, match="too unevenly"):
        recording.markers("waist")


def test_trackers_become_markers():
    recording = Recording()
    for frame in range(8):
        if frame == 5:
            continue
        recording.add(message(TIME, 100.0 + frame / 50), 0.0)
        recording.add(message("/VMC/Ext/Hmd/Pos", "HMD-7", 0.1, 1.7, 0.2, 0.0, 0.0, 0.0, 1.0), 0.0)
        recording.add(message("/VMC/Ext/Con/Pos", "", 0.5, 1.0, frame / 10, 0.0, 0.0, 0.0, 1.0), 0.0)
        if frame != 2:
            recording.add(message("/VMC/Ext/Tra/Pos", "LHR-1", -0.2, 0.9, 0.0, 0.0, 0.0, 0.0, 1.0), 0.0)
    take = recording.markers("trackers")
    assert take.names == ("HMD-7", "Con", "LHR-1")
    assert take.fps == 50.0
    assert list(take.frame_numbers) == [0, 1, 2, 3, 4, 6, 7]
    assert take.positions_m[:, 0] == pytest.approx(np.tile([-0.1, 1.7, 0.2], (7, 1)), abs=1e-6)
    assert take.positions_m[:, 1, 2] == pytest.approx(np.array([0, 1, 2, 3, 4, 6, 7]) / 10, abs=1e-6)
    assert list(np.isnan(take.positions_m[:, 2, 0])) == [False, False, True, False, False, False, False]
    with pytest.raises(TakeError, match="only 0 frames with bones arrived in"):
        recording.motion("trackers")
    with pytest.raises(TakeError, match="only 0 frames with trackers arrived in 0 packets"):
        Recording().markers("nothing")


def test_a_tracker_that_turns_leaves_points_on_its_axes():
    turns = rot.from_rotation_vector(np.linspace((0.0, 0.0, 0.0), (0.1, 0.6, -0.3), 5))
    recording = Recording()
    for at, turn in enumerate(turns):
        recording.add(message(TIME, at / 50), 0.0)
        recording.add(tracker_packet({"waist": (0.1, 1.0, 0.2), "foot": (0.0, 0.1, 0.0)}, {"waist": turn}), 0.0)
    take = recording.markers("trackers")
    assert take.names == ("waist", "waist x", "waist y", "waist z", "foot")
    np.testing.assert_allclose(take.positions_m[:, 0], np.tile([0.1, 1.0, 0.2], (5, 1)), atol=1e-6)
    away = take.positions_m[:, 1:4] - take.positions_m[:, :1]
    np.testing.assert_allclose(away, rot.rotate(turns[:, None], 0.1 * np.eye(3)), atol=1e-6)


def test_a_sender_of_ever_new_names_is_recorded_in_bounded_memory():
    recording = Recording()
    for at in range(60):
        recording.add(tracker_packet({"own": (0, 1, 0)} | {f"{at}-{i}": (0, 1, 0) for i in range(50)}), at / 60)
    take = recording.markers("a")
    assert len(take.names) == LIMITS.placed
    assert (take.names[0], take.frames) == ("own", 60)

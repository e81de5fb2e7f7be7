"""Poses sent to another program on their way to Blender."""

import numpy as np
import pytest
from osc_frames import frame_packet
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.formats.take_file.pose_codec import TimedPose, unpack_solved
from perfanim.core.formats.vmc.humanoid import bone_poses
from perfanim.core.formats.vmc.vmc_packets import BONE, Placement, read_packet
from perfanim.core.formats.vmc.vmc_udp import Receiver
from perfanim.core.session.pose_filters import FilterSettings, PoseFilter
from perfanim.core.worker.jobs.capture_stages import PoseOutput
from perfanim.core.worker.vmc_sender import VmcSender

SINGLE = float(np.finfo(np.float32).eps)
SMOOTH = FilterSettings(smoothing_s=0.05)


class PlayedChannel:
    """Keeps the poses sent to Blender."""

    def __init__(self):
        self.sent = []

    def take_filter_settings(self):
        return None

    def send_pose(self, record):
        self.sent.append(record)


@pytest.fixture
def poses(truth):
    nowhere, alone = np.full((8, 3), np.nan), np.full(8, -1)
    return [
        ScenePose((PerformerPose(n, n / 30, turns, root_m, 1.0, nowhere, nowhere, alone, 0.0),))
        for n, (turns, root_m) in enumerate(zip(truth.rotations[:12], truth.root_positions_m[:12], strict=True))
    ]


def test_what_is_sent_is_what_is_shown(truth, subject, poses):
    told = []
    with Receiver(0) as receiver:
        sender = VmcSender(truth.skeleton, "127.0.0.1", receiver.port, told.append)
        channel = PlayedChannel()
        output = PoseOutput(PoseFilter([subject], None, SMOOTH), channel, None, sender)
        alone = PoseFilter([subject], None, SMOOTH)
        for pose in poses:
            output.put(TimedPose(pose, 0.0), None)
            assert output.send()
            (shown,), (own,) = unpack_solved(channel.sent[-1]).pose.performers, alone.step(pose).performers
            np.testing.assert_array_equal(shown.rotations, own.rotations)
            packet = receiver.receive(10.0)
            hips = next(m for m in read_packet(packet) if isinstance(m, Placement) and m.address == BONE)
            assert hips.position_m == pytest.approx(shown.root_position_m, abs=1e-5)
        assert receiver.receive(0.0) is None
    assert told == []


def test_a_packet_made_quickly_is_the_same(truth, poses):
    with Receiver(0) as receiver:
        sender = VmcSender(truth.skeleton, "127.0.0.1", receiver.port, lambda text: None)
        expected = bone_poses(truth)
        for n, pose in enumerate(poses):
            sender.send(pose)
            packet = frame_packet(pose.time_s, expected.names, expected.positions_m[n], expected.rotations[n])
            sent = receiver.receive(10.0)
            assert len(sent) == len(packet)
            for one, other in zip(read_packet(sent), read_packet(packet), strict=True):
                if not isinstance(one, Placement):
                    assert one == other
                    continue
                assert (one.address, one.name) == (other.address, other.name)
                # a frame's poses and a motion's round differently before they are turned to single precision
                assert one.position_m == pytest.approx(other.position_m, abs=SINGLE)
                assert one.rotation == pytest.approx(other.rotation, abs=SINGLE)


def test_what_cannot_be_sent_is_told_once_and_holds_nothing_up(truth, poses):
    told = []
    for host, port in (("no.such.host.invalid", 39539), ("::1%no-such-link", 39539)):
        sender = VmcSender(truth.skeleton, host, port, told.append)
        for pose in poses:
            sender.send(pose)
        assert len(told) == 1
        assert told.pop().startswith(f"nothing is sent over VMC: {host}:{port}: cannot be reached")

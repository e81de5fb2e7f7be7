"""Packets: as the protocol has them, and nothing that comes may do harm."""

import logging

import numpy as np
import pytest
from osc_frames import frame_packet, message
from perfanim.core.errors import FormatError
from perfanim.core.formats.vmc.frame_assembler import FrameAssembler
from perfanim.core.formats.vmc.humanoid import BONES, bone_poses
from perfanim.core.formats.vmc.vmc_packets import BONE, ROOT, Clock, Placement, read_packet
from perfanim.core.geometry import rotations as rot
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_packet import OscPacket
from pythonosc.parsing import osc_types

NUMBERS = (0.5, 1.0, 2.0, 0.0, 0.0, 0.0, 1.0)


def bundle(*items):
    return b"#bundle\0" + bytes(7) + b"\1" + b"".join(len(item).to_bytes(4, "big") + item for item in items)


def nested(depth):
    packet = bundle()
    for _ in range(depth):
        packet = bundle(packet)
    return packet


@pytest.fixture(scope="module")
def packet(truth):
    poses = bone_poses(truth)
    return frame_packet(0.25, poses.names, poses.positions_m[7], poses.rotations[7])


def test_a_frame_is_one_bundle_of_the_protocols_messages(packet):
    assert OscBundle.dgram_is_bundle(packet)
    messages = [timed.message for timed in OscPacket(packet).messages]
    assert [m.address for m in messages[:3]] == ["/VMC/Ext/OK", "/VMC/Ext/T", "/VMC/Ext/Root/Pos"]
    assert {m.address for m in messages[3:]} == {"/VMC/Ext/Bone/Pos"}
    assert [m.params[0] for m in messages[3:]] == list(BONES)
    tags = {m.address: osc_types.get_string(m.dgram, osc_types.get_string(m.dgram, 0)[1])[0] for m in messages}
    assert tags == {"/VMC/Ext/OK": ",i", "/VMC/Ext/T": ",f", ROOT: ",sfffffff", BONE: ",sfffffff"}
    assert messages[0].params == [1]
    assert messages[1].params == [0.25]
    assert messages[2].params == ["root", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


def test_axes_are_unitys():
    """Unity: x to the right, left-handed, so a positive turn about y goes from z (forward) to x (right)."""
    left_and_up = np.array([[0.3, 1.0, 0.2]])
    to_the_left = rot.from_rotation_vector(np.array([[0.0, 0.5, 0.0]]))  # ours: from z forward to x left
    sent = OscPacket(frame_packet(0.0, ("Hips",), left_and_up, to_the_left)).messages[3].message.params
    assert sent[1:4] == pytest.approx([-0.3, 1.0, 0.2])
    assert sent[4:] == pytest.approx([0.0, -np.sin(0.25), 0.0, np.cos(0.25)])
    nod = rot.from_rotation_vector(np.array([[0.5, 0.0, 0.0]]))  # from up to forward: the same in both
    sent = OscPacket(frame_packet(0.0, ("Hips",), left_and_up, nod)).messages[3].message.params
    assert sent[4:] == pytest.approx([np.sin(0.25), 0.0, 0.0, np.cos(0.25)])


def test_what_is_read_is_what_was_sent(truth):
    poses = bone_poses(truth)
    for frame in range(0, truth.frames, 10):
        packet = frame_packet(frame / 30, poses.names, poses.positions_m[frame], poses.rotations[frame])
        clock, root, *bones = read_packet(packet)
        assert clock.time_s == pytest.approx(frame / 30)
        assert (root.address, root.name) == (ROOT, "root")
        assert tuple(bone.name for bone in bones) == poses.names
        turns = rot.angle_between([bone.rotation for bone in bones], poses.rotations[frame])
        assert turns.max() < 1e-5
        assert np.abs([bone.position_m for bone in bones] - poses.positions_m[frame]).max() < 1e-6


def test_bundles_in_bundles_trackers_and_later_versions_are_read_and_the_rest_passed_over():
    packet = bundle(
        message("/VMC/Ext/Blend/Val", "Joy", 0.5),
        bundle(message("/VMC/Ext/Tra/Pos", "LHR-1", *NUMBERS), bundle()),
        message(ROOT, "root", *NUMBERS, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0),
    )
    tracker, root = read_packet(packet)
    assert isinstance(tracker, Placement)
    assert (tracker.address, tracker.name) == ("/VMC/Ext/Tra/Pos", "LHR-1")
    assert tracker.position_m == pytest.approx([-0.5, 1.0, 2.0])
    assert root.name == "root"
    assert read_packet(message("/VMC/Ext/T", 2.5, tags="f")) == [Clock(2.5)]


@pytest.mark.parametrize(
    ("packet", "reason"),
    [
        (b"", "not an OSC packet"),
        (b"hello", "not an OSC packet"),
        (b"#bundle\0\0\0\0", "not an OSC packet"),
        (bundle(b"junk"), "not an OSC packet"),
        (bundle() + b"\xff\xff\xff\xfc", "sizes"),  # points at itself
        (bundle() + bytes(4), "sizes"),
        (bundle(message(BONE, "Hips", *NUMBERS))[:-4], "sizes"),
        (message(BONE, "Hips", *NUMBERS)[:-4], "damaged"),
        (message(BONE, "Hips", *NUMBERS[:6]), "types"),
        (message(BONE, *NUMBERS, 1.0, tags="ffffffff"), "types"),
        (b"/VMC/Ext/Bone/Pos", "damaged|types"),
        (message(BONE, "Hips", np.nan, *NUMBERS[1:]), "finite"),
        (message(BONE, "Hips", *NUMBERS[:6], 0.0), "rotation"),
        (nested(3000), "deep"),
        (message(BONE, "x" * 60_000, *NUMBERS), "name of 60000 characters"),
        (message("/VMC/Ext/T", np.inf, tags="f"), "finite"),
        (message(BONE, "Hips", *NUMBERS).replace(b"Hips", b"\xff\xfe\xff\xfe"), "damaged"),
    ],
)
def test_malformed_packets_are_refused(packet, reason):
    with pytest.raises(FormatError, match=reason):
        read_packet(packet)


def test_a_bad_message_does_not_take_its_bundle_along():
    bad = message(BONE, "Chest", *NUMBERS[:4])
    faults = []
    found = read_packet(bundle(message(BONE, "Hips", *NUMBERS), bad, b"junk", message(BONE, "Head", *NUMBERS)), faults)
    assert [placement.name for placement in found] == ["Hips", "Head"]
    assert len(faults) == 2 and "types" in faults[0] and "not an OSC packet" in faults[1]
    assembler = FrameAssembler()
    for _ in range(3):
        assembler.add(bundle(message(BONE, "Hips", *NUMBERS), bad), 0.0)
    assert (assembler.packets, assembler.malformed, assembler.understood) == (3, 3, 3)


def test_no_packet_does_harm(packet, caplog):
    """Bytes changed, cut off and put in at random: read, or refused with our own error; nothing is logged."""
    rng = np.random.default_rng(5)
    refused = 0
    with caplog.at_level(logging.DEBUG):
        for _ in range(600):
            broken = bytearray(packet[: rng.integers(1, len(packet))] if rng.random() < 0.2 else packet)
            for at in rng.integers(0, len(broken), rng.integers(1, 6)):
                broken[at] = rng.choice([0, 255, 44, rng.integers(256)])
            try:
                read_packet(bytes(broken))
            except FormatError:
                refused += 1
    assert 100 < refused < 600
    assert not caplog.records

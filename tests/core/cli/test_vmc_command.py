"""`perfanim vmc`: sent by one command, recorded by the other."""

import json
import socket
from contextlib import ExitStack

import numpy as np
import pytest
from osc_frames import frame_packet, message
from perfanim.core.body.motion import sliced
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.cli.main import build_parser, main
from perfanim.core.database.store import identity
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.take_file.pose_codec import TimedPose
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.formats.vmc.humanoid import bone_poses
from perfanim.core.formats.vmc.vmc_packets import BONE, read_packet
from perfanim.core.formats.vmc.vmc_udp import Receiver, Sender
from perfanim.core.markers.marker_take import load_take
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message import OscMessage
from trackers_sent import tracker_packet


def run(line, once_listening):
    """Run a receiving command; when it listens, `once_listening(port)` is called."""
    args = build_parser(["vmc"]).parse_args(["vmc", "receive", "--port", "0", *map(str, line)])
    called = []

    def progress(fraction, text):
        if not called:
            called.append(text)
            once_listening(int(text.rpartition(" ")[2]))

    return args.run(args, progress)


def test_send_and_receive(tmp_path, truth, capsys):
    write_bvh(sliced(truth, 0, 10), tmp_path / "walk.bvh")

    def send(port):
        assert main(["vmc", "send", str(tmp_path / "walk.bvh"), "--to", f"127.0.0.1:{port}", "--json"]) == 0

    facts = run(["--out", tmp_path / "again.bvh", "--seconds", "0.01"], send)
    sent = json.loads(capsys.readouterr().out)
    assert (sent["frames"], sent["fps"], sent["bones"]) == (10, 30.0, 22)
    assert {key: facts[key] for key in ("frames", "lost_frames", "fps", "packets", "malformed")} == {
        "frames": 10, "lost_frames": 0, "fps": 30.0, "packets": 10, "malformed": 0,
    }  # fmt: skip
    again = read_motion(tmp_path / "again.bvh")
    assert again.root_positions_m == pytest.approx(truth.root_positions_m[:10], abs=1e-5)


def test_a_recorded_take_is_sent_as_it_was_solved_live(tmp_path, truth, subject, database, stage_rig, capsys):
    setup = TakeSetup.of(stage_rig, (subject,), {}, identity(database), {})
    nowhere, alone = np.full((len(subject.marker_set), 3), np.nan), np.full(len(subject.marker_set), -1)
    poses = [
        PerformerPose(n, n / 30, truth.rotations[n], truth.root_positions_m[n], 1.0, nowhere, nowhere, alone, np.nan)
        for n in range(8)
    ]
    path = tmp_path / "walk.perftake"
    write_whole_take(path, setup, TakeNotes("Walk"), [], [TimedPose(ScenePose((pose,)), pose.time_s) for pose in poses])
    with Receiver(0) as receiver:
        assert main(["vmc", "send", str(path), "--to", f"127.0.0.1:{receiver.port}", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["frames"] == 8
        hips = next(m for m in read_packet(receiver.receive(0.0)) if getattr(m, "name", "") == "Hips")
    assert hips.position_m == pytest.approx(truth.root_positions_m[0], abs=1e-6)


def test_rate(tmp_path, truth, capsys):
    write_bvh(sliced(truth, 0, 10), tmp_path / "walk.bvh")
    with Receiver(0) as receiver:
        line = ["vmc", "send", str(tmp_path / "walk.bvh"), "--to", f"127.0.0.1:{receiver.port}", "--rate", "60"]
        assert main([*line, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 19


def test_trackers_to_a_marker_take(tmp_path):
    def send(port):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            for _ in range(3):
                link.sendto(tracker_packet({"waist": (-0.5, 1.0, 2.0)}), ("127.0.0.1", port))
            link.sendto(b"noise", ("127.0.0.1", port))

    facts = run(["--out", tmp_path / "waist.take.npz", "--seconds", "0.01"], send)
    assert (facts["frames"], facts["names"], facts["malformed"]) == (3, ["waist"], 1)
    assert load_take(tmp_path / "waist.take.npz").positions_m == pytest.approx(np.tile([-0.5, 1.0, 2.0], (3, 1, 1)))


@pytest.mark.parametrize(
    ("clock_s", "lost"), [((0.0, 0.1, 0.2, 0.5, 0.6), 2), ((0.0, 0.1, 0.23, 0.31, 0.385, 0.5, 0.55), 0)]
)
@pytest.mark.parametrize("ending", ["take.npz", "csv"])
def test_lost_frames_of_trackers_are_counted_by_their_times(tmp_path, ending, clock_s, lost):
    def send(port):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            for time_s in clock_s:
                link.sendto(message("/VMC/Ext/T", time_s), ("127.0.0.1", port))
                link.sendto(tracker_packet({"waist": (time_s, 1.0, 2.0)}), ("127.0.0.1", port))

    facts = run(["--out", tmp_path / f"waist.{ending}", "--seconds", "0.01"], send)
    assert (facts["frames"], facts["lost_frames"]) == (len(clock_s), lost)


def test_one_of_two_programs_is_recorded_and_the_other_named(tmp_path):
    def send(port):
        with ExitStack() as open_sockets:
            links = [open_sockets.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)]
            for number in range(5):
                for link, height in zip(links, (1.0, 1.2), strict=True):
                    packet = message("/VMC/Ext/Tra/Pos", "waist", 0.1 * number, height, 2.0, 0.0, 0.0, 0.0, 1.0)
                    link.sendto(packet, ("127.0.0.1", port))
            other.append(links[1].getsockname()[1])

    other = []
    facts = run(["--out", tmp_path / "waist.take.npz", "--seconds", "0.01"], send)
    assert (facts["frames"], facts["packets"]) == (5, 5)
    assert facts["warnings"][0].startswith(f"ignored 127.0.0.1:{other[0]}, which sent to the same port")
    assert load_take(tmp_path / "waist.take.npz").positions_m[:, 0, 1] == pytest.approx(1.0)


def test_a_bad_message_in_every_bundle_costs_its_bone_alone(tmp_path, truth):
    def send(port):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            for row in range(4):
                builder = OscBundleBuilder(IMMEDIATELY)
                builder.add_content(OscMessage(message(BONE, "Chest", *np.zeros(4))))
                builder.add_content(OscBundle(frame_packet(row / 30.0, poses.names, *frames[row])))
                link.sendto(builder.build().dgram, ("127.0.0.1", port))

    poses = bone_poses(sliced(truth, 0, 4))
    frames = list(zip(poses.positions_m, poses.rotations, strict=True))
    facts = run(["--out", tmp_path / "a.bvh", "--seconds", "0.01"], send)
    assert (facts["frames"], facts["packets"], facts["malformed"]) == (4, 4, 4)


def test_the_newer_protocol_is_heard_where_it_is_asked_for(tmp_path, truth):
    def send(port):
        with Sender(truth.skeleton, "::1", port) as sender:
            for frame in range(4):
                sender.send(frame / 30.0, truth.rotations[frame], truth.root_positions_m[frame])

    assert run(["--out", tmp_path / "a.bvh", "--seconds", "0.01", "--from", "::1"], send)["frames"] == 4


def test_bad_input_is_told(tmp_path, capsys):
    line = ["vmc", "receive", "--port", "0", "--seconds", "0.01", "--out"]
    assert main([*line, str(tmp_path / "nothing.bvh")]) == 1
    told = capsys.readouterr().err
    assert "0 frames with bones arrived" in told and "127.0.0.1" in told
    assert main([*line, str(tmp_path / "nothing.fbx")]) == 1
    assert "does not have an extension that can be written" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    for words in (["--to", "nowhere"], ["--to", "host:0"], ["--to", "host:70000"], ["--rate", "-1"], ["--rate", "x"]):
        with pytest.raises(SystemExit) as wrong:
            main(["vmc", "send", "a.bvh", *words])
        assert wrong.value.code == 2


@pytest.mark.parametrize(("options", "address"), [([], "127.0.0.1"), (["--from", "any"], "")])
def test_only_this_computer_is_listened_to_by_default(tmp_path, monkeypatch, options, address):
    opened = []

    class ClosedError(Exception):
        pass

    def receiver(port, sender):
        opened.append((port, sender))
        raise ClosedError

    monkeypatch.setattr("perfanim.core.cli.vmc_command.Receiver", receiver)
    with pytest.raises(ClosedError):
        run(["--out", tmp_path / "a.bvh", "--seconds", "0.01", *options], lambda _: None)
    assert opened == [(0, address)]

"""The whole live chain without Blender: cameras' process, solver's process, poses."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motion_synthesis import perform
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.errors import CaptureError, SettingsError
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.take_file.pose_codec import pack_solved
from perfanim.core.formats.take_file.take_reader import read_take_file, summarise
from perfanim.core.formats.vmc.vmc_packets import Clock, read_packet
from perfanim.core.formats.vmc.vmc_udp import Receiver
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.prop import load_prop, prop_tables
from perfanim.core.markers.subject import Subject, subject_tables
from perfanim.core.session.pose_filters import FilterSettings
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.worker.client import WorkerClient
from perfanim.core.worker.protocol import Message, MessageKind
from perfanim.core.worker.requests import read_request
from perfanim.core.worker.restart_point import RestartPoint
from props import held_poses
from soak.processes import children, is_running

PATIENCE_S = 180.0
ROOT_M = 0.3  # a quarter of what two performers are apart: nobody is taken for the other


@pytest.fixture(scope="module")
def request_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("chain")
    write_bvh(perform("walking", 4.0), folder / "walk.bvh")
    build_database([str(folder / "walk.bvh")], folder / "walk.pfdb", BuildSettings(fps=60.0))
    subject = Subject("Sim", default_skeleton(1.75), load_marker_set("boxing"))
    return {"performers": [subject_tables(subject)], "database": str(folder / "walk.pfdb")}


def request(files: dict[str, Any], **source: Any) -> dict[str, Any]:
    simulated = {"kind": "simulated", "behaviour": "walking", "seconds": 4.0, "height_m": 1.75}
    cameras = {"source": {**simulated, **source}, "rig": None, "threshold": None}
    return {"job": "capture", "cameras": cameras, **files}


def collect(
    client: WorkerClient, until: Callable[[list[Message]], bool], earlier: list[Message] | None = None
) -> list[Message]:
    """Return the earlier messages, with those added that come until the condition holds; each pose is confirmed."""
    messages = [] if earlier is None else earlier
    limit = time.monotonic() + PATIENCE_S
    while not until(messages):
        assert time.monotonic() < limit, [(m.kind.name, m.payload[:80]) for m in messages][-5:]
        messages += client.poll()
        client.acknowledge(len(of(MessageKind.POSE, messages)))
        client.wait(0.05)
    return messages


def of(kind: MessageKind, messages: list[Message]) -> list[Message]:
    return [message for message in messages if message.kind is kind]


def test_every_frame_of_a_source_that_ends_is_solved_and_kept(request_files: dict[str, Any], tmp_path: Path) -> None:
    path, packets = tmp_path / "walk.perftake", []
    with Receiver(0) as receiver:
        asked = {"take": str(path), "character": "Xbot", "vmc": {"host": "127.0.0.1", "port": receiver.port}}
        capture = request(request_files)
        client = WorkerClient({**capture, **asked})

        def received(_: list[Message]) -> bool:
            while packet := receiver.receive(0.0):
                packets.append(packet)
            return client.ended

        try:
            messages = collect(client, received)
            received(messages)
        finally:
            client.close()
    assert not of(MessageKind.ERROR, messages)
    solved = [message.pose() for message in of(MessageKind.POSE, messages)]
    numbers = [each.pose.number for each in solved]
    assert numbers == list(range(len(numbers)))
    filmed = open_simulated(capture["cameras"]["source"]).frames
    assert messages[-1].json()["handed_over"] == len(numbers) == filmed > 300  # T pose, arms down, walking, standing
    assert np.mean([each.pose.performers[0].confidence for each in solved]) > 0.5
    assert not of(MessageKind.PREVIEW, messages)  # nobody asked for it
    # another program has got each pose, at its time
    clocks = [message.time_s for packet in packets for message in read_packet(packet) if isinstance(message, Clock)]
    assert clocks == pytest.approx([each.pose.time_s for each in solved], abs=1e-5)
    stamps = [each.stamp_s for each in solved]
    assert stamps == sorted(stamps)
    take = read_take_file(path)
    assert take.complete
    assert take.notes.character == "Xbot"
    assert [pack_solved(pose) for pose in take.poses] == [m.payload for m in of(MessageKind.POSE, messages)]
    assert [frame.number for frame in take.frames] == numbers
    assert not summarise(path).orphaned


def test_stop_ends_the_chain_and_loses_nothing(request_files: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "walk.perftake"
    asked = {
        **request(request_files, loop=True, prop="sword"),
        "take": str(path),
        "props": [prop_tables(load_prop("sword"))],
    }
    asked["shape"] = {"smoothing_s": 0.1, "feet": "auto"}
    asked["cameras"]["preview"] = True
    client = WorkerClient(asked)
    try:
        messages = collect(client, lambda m: len(of(MessageKind.POSE, m)) >= 20 and bool(of(MessageKind.PREVIEW, m)))
        client.set_filter(FilterSettings())
        tuned_at = len(of(MessageKind.POSE, messages))
        messages = collect(client, lambda m: len(of(MessageKind.POSE, m)) >= tuned_at + 10, messages)
        client.request_stop()
        messages = collect(client, lambda _: client.ended, messages)
    finally:
        client.close()
    assert messages[-1].json()["handed_over"] == len(of(MessageKind.POSE, messages)) >= 20
    told = [m.json() for m in of(MessageKind.STATUS, messages) if "blind" in m.json()]
    assert told[0]["blind"] == 0
    assert abs(told[0]["skew_s"]) < 1 / 60
    take = read_take_file(path)
    kept = [pack_solved(solved) for solved in take.poses]  # always as they were solved
    changed = np.array([mine != m.payload for mine, m in zip(kept, of(MessageKind.POSE, messages), strict=True)])
    assert changed[1:tuned_at].all()
    assert not changed[tuned_at + 5 :].any()  # some were on their way
    assert [prop.name for prop in take.setup.carried_props()] == ["sword"]
    _, places_m = held_poses(load_prop("sword"), open_simulated(asked["cameras"]["source"]).motion)
    for solved in take.poses[10:]:  # it is known at once, or after a tenth of a second
        (sword,) = solved.pose.props
        assert np.linalg.norm(sword.position_m - places_m[solved.pose.number]) < 0.01
    picture = of(MessageKind.PREVIEW, messages)[0].preview().astype(int)
    assert picture.shape == (240, 640, 3)
    ringed = (picture[..., 1] - picture[..., [0, 2]].max(axis=2) > 80).sum(axis=0)  # green: in both cameras' images
    assert ringed[:320].sum() > 20 and ringed[320:].sum() > 20


def test_two_performers_are_followed_live(request_files: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "pair.perftake"
    asked = request(request_files, loop=True, partners=[{"height_m": 1.7}])
    client = WorkerClient({**asked, "take": str(path), "performers": 2 * request_files["performers"]})
    try:
        messages = collect(client, lambda m: len(of(MessageKind.POSE, m)) >= 8)
        client.request_stop()
        messages = collect(client, lambda _: client.ended, messages)
    finally:
        client.close()
    take = read_take_file(path)
    assert [worn.name for worn in take.setup.subjects()[1:]] == ["Sim"]
    everybody = open_simulated(asked["cameras"]["source"]).performance.everybody
    for message in of(MessageKind.POSE, messages):
        pose = message.pose().pose
        for one, true in zip(pose.performers, everybody, strict=True):
            root_m = true.motion.root_positions_m[pose.number]
            assert np.linalg.norm(one.root_position_m - root_m) < ROOT_M


@pytest.mark.long
def test_stop_while_the_background_is_learned_is_a_clean_end(request_files: dict[str, Any]) -> None:
    client = WorkerClient(request(request_files, loop=True))
    try:

        def learning(messages: list[Message]) -> bool:
            return any("background" in str(m.json().get("activity")) for m in of(MessageKind.STATUS, messages))

        messages = collect(client, learning)
        client.request_stop()
        messages = collect(client, lambda _: client.ended, messages)
    finally:
        client.close()
    assert not of(MessageKind.ERROR, messages)


@pytest.mark.long
def test_the_simulated_performer_waits_for_who_watches(request_files: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "walk.perftake"
    client = WorkerClient({**request(request_files, loop=True), "take": str(path)})
    try:
        messages: list[Message] = []
        limit = time.monotonic() + PATIENCE_S
        for taken in range(4):
            client.acknowledge(taken)
            while len(of(MessageKind.POSE, messages)) <= taken:
                assert time.monotonic() < limit
                messages += client.poll()
                client.wait(0.05)
            time.sleep(0.3)
            messages += client.poll()
            assert len(of(MessageKind.POSE, messages)) == taken + 1  # the next comes when this one is confirmed
    finally:
        client.close()
    take = read_take_file(path)  # who watched is gone, as when Blender dies: the take ends as it should all the same
    assert take.complete
    assert summarise(path).orphaned
    assert len(take.frames) >= 4


def test_bad_requests_are_errors_in_plain_words(request_files: dict[str, Any], tmp_path: Path) -> None:
    missing = str(tmp_path / "none.pfdb")
    bad = {
        "none.pfdb": {**request(request_files), "database": missing},
        "unknown behaviour": request(request_files, behaviour="flying"),
    }
    for expected, asked in bad.items():
        client = WorkerClient(asked)
        try:
            (error,) = of(MessageKind.ERROR, collect(client, lambda _, c=client: c.ended))
        finally:
            client.close()
        assert expected in str(error.error())
    with pytest.raises(SettingsError, match="unknown setting"):
        read_request("capture", request(request_files, speed=3))


def wait_until_gone(process_ids: list[int]) -> None:
    limit = time.monotonic() + PATIENCE_S
    while any(map(is_running, process_ids)):
        assert time.monotonic() < limit, "a process stays"
        time.sleep(0.05)


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="looks at /proc")
def test_processes_that_die_or_hang_are_replaced_and_the_take_goes_on(
    request_files: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / "walk.perftake"
    # live: what happens meanwhile is missing, as with cameras
    asked = {**request(request_files, live=True), "take": str(path)}
    asked["cameras"]["background_file"] = str(tmp_path / "background.npz")
    client = WorkerClient(asked)
    try:
        messages = collect(client, lambda m: len(of(MessageKind.POSE, m)) >= 10)
        solver = client.process_id
        (first_cameras,) = children(solver)
        os.kill(first_cameras, signal.SIGKILL)

        def is_mended(told: list[Message]) -> bool:
            return any("restarted" in str(m.json().get("text")) for m in of(MessageKind.WARNING, told))

        messages = collect(client, is_mended, messages)
        count = len(of(MessageKind.POSE, messages))
        messages = collect(client, lambda m: len(of(MessageKind.POSE, m)) >= count + 10, messages)
        (second_cameras,) = children(solver)
        os.kill(solver, signal.SIGSTOP)
        with pytest.raises(CaptureError, match="sent nothing for"):
            collect(client, lambda _: False, messages)
        count = len(of(MessageKind.POSE, messages))
        last = read_take_file(path).poses[-1]
        assert client.may_restart
        point = RestartPoint(last.pose.number, last.pose.time_s, last.stamp_s)
        client.restart(point, "the solver process hung")
        messages = collect(client, lambda m: len(of(MessageKind.POSE, m)) >= count + 10, messages)
        wait_until_gone([first_cameras, solver, second_cameras])
        client.request_stop()
        collect(client, lambda _: client.ended, messages)
    finally:
        client.close()
    take = read_take_file(path)
    assert take.complete
    assert [gap.text.partition(":")[0] for gap in take.gaps] == [
        "the camera process ended unexpectedly (status -9)",
        "the solver process hung",
    ]
    numbers = np.array([frame.number for frame in take.frames])
    stamps_s, times_s = np.array([(stamp_s, frame.time_s) for stamp_s, frame in take.stamped_frames]).T
    assert np.all(np.diff(numbers) > 0)
    for gap in take.gaps:
        before = int(np.searchsorted(numbers, gap.after))
        assert numbers[before] == gap.after
        passed_s = float(times_s[before + 1] - times_s[before])
        # by the clock, to what the images' way to the stamp varies by
        assert passed_s == pytest.approx(stamps_s[before + 1] - stamps_s[before], abs=0.1)
        assert passed_s == pytest.approx((numbers[before + 1] - numbers[before]) / 60, abs=0.6 / 60)
        assert gap.seconds == pytest.approx(passed_s - 1 / 60, abs=1e-3)
    assert not (tmp_path / "background.npz").exists()


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="looks at /proc")
def test_no_process_is_left_when_blender_is_killed(request_files: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "walk.perftake"
    asked = {**request(request_files, loop=True), "take": str(path)}
    line = [
        sys.executable,
        str(Path(__file__).with_name("in_blenders_place.py")),
        json.dumps(asked, default=np.ndarray.tolist),
    ]
    blender = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
    try:
        assert blender.stdout is not None
        solver = int(blender.stdout.readline())
        assert blender.stdout.readline() == "capturing\n"
        family = [solver, *children(solver)]
        assert len(family) == 2
    finally:
        blender.kill()
        blender.wait()
    wait_until_gone(family)
    assert read_take_file(path).complete
    assert summarise(path).orphaned

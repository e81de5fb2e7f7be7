"""The whole live chain without Blender: cameras' process, solver's process, poses."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perfanim.core.database.build import build_database
from perfanim.core.formats.bvh import write_bvh
from perfanim.core.marker_set import Subject, load_marker_set, save_subject
from perfanim.core.pose_bytes import pack_solved
from perfanim.core.product_skeleton import default_skeleton
from perfanim.core.simulate.performer import perform
from perfanim.core.take_file.reading import read_take_file, summarise
from perfanim.core.worker.client import WorkerClient
from perfanim.core.worker.protocol import Message, MessageKind

PATIENCE_S = 180.0


@pytest.fixture(scope="module")
def request_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("chain")
    write_bvh(perform("walking", 4.0), folder / "walk.bvh")
    build_database([str(folder / "walk.bvh")], folder / "walk.perfdb", 60.0)
    save_subject(Subject("Sim", default_skeleton(1.75), load_marker_set("boxing")), folder / "sim.toml")
    return {"subject": str(folder / "sim.toml"), "database": str(folder / "walk.perfdb")}


def request(files: dict[str, str], **source: Any) -> dict[str, Any]:
    simulated = {"kind": "simulated", "behaviour": "walking", "seconds": 4.0, "height_m": 1.75}
    cameras = {"source": {**simulated, **source}, "rig": None, "threshold": None}
    return {"job": "capture", "cameras": cameras, **files}


def collect(
    client: WorkerClient, until: Callable[[list[Message]], bool], earlier: list[Message] | None = None
) -> list[Message]:
    """Return the earlier messages and those that come until the condition holds, confirming each pose."""
    messages = list(earlier or [])
    limit = time.monotonic() + PATIENCE_S
    while not until(messages):
        assert time.monotonic() < limit, [(m.kind.name, m.payload[:80]) for m in messages][-5:]
        messages += client.poll()
        client.confirm_taken(len(of(MessageKind.POSE, messages)))
        client.wait(0.05)
    return messages


def of(kind: MessageKind, messages: list[Message]) -> list[Message]:
    return [message for message in messages if message.kind is kind]


def test_every_frame_of_a_source_that_ends_is_solved_and_kept(request_files: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "walk.perftake"
    client = WorkerClient({**request(request_files), "take": str(path), "character": "Xbot"})
    try:
        messages = collect(client, lambda _: client.ended)
    finally:
        client.close()
    assert not of(MessageKind.ERROR, messages)
    solved = [message.pose() for message in of(MessageKind.POSE, messages)]
    numbers = [each.pose.number for each in solved]
    assert numbers == list(range(len(numbers)))
    assert messages[-1].json()["handed_over"] == len(numbers) > 300  # T pose, arms down, 4 s of walking, standing
    assert np.mean([each.pose.confidence for each in solved]) > 0.5
    assert not of(MessageKind.PREVIEW, messages)  # nobody asked for it
    stamps = [each.stamp_s for each in solved]
    assert stamps == sorted(stamps)
    take = read_take_file(path)
    assert take.complete
    assert take.notes.character == "Xbot"
    assert [pack_solved(pose) for pose in take.poses] == [m.payload for m in of(MessageKind.POSE, messages)]
    assert [frame.number for frame in take.frames] == numbers
    assert not summarise(path).orphaned


def test_stop_ends_the_chain_and_loses_nothing(request_files: dict[str, str]) -> None:
    asked = request(request_files, loop=True)
    asked["cameras"]["preview"] = True
    client = WorkerClient(asked)
    try:
        messages = collect(client, lambda m: len(of(MessageKind.POSE, m)) >= 20 and bool(of(MessageKind.PREVIEW, m)))
        client.request_stop()
        messages = collect(client, lambda _: client.ended, messages)
    finally:
        client.close()
    assert messages[-1].json()["handed_over"] == len(of(MessageKind.POSE, messages)) >= 20
    picture = of(MessageKind.PREVIEW, messages)[0].preview().astype(int)
    assert picture.shape == (240, 640, 3)
    ringed = (picture[..., 1] - picture[..., [0, 2]].max(axis=2) > 80).sum(axis=0)  # green: in both cameras' images
    assert ringed[:320].sum() > 20 and ringed[320:].sum() > 20


def test_stop_while_the_background_is_learned_is_a_clean_end(request_files: dict[str, str]) -> None:
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


def test_the_simulated_performer_waits_for_who_watches(request_files: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "walk.perftake"
    client = WorkerClient({**request(request_files, loop=True), "take": str(path)})
    try:
        messages: list[Message] = []
        limit = time.monotonic() + PATIENCE_S
        for taken in range(4):
            client.confirm_taken(taken)
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


def test_bad_requests_are_errors_in_plain_words(request_files: dict[str, str], tmp_path: Path) -> None:
    missing = str(tmp_path / "none.perfdb")
    bad = {
        "none.perfdb": {**request(request_files), "database": missing},
        "unknown setting": request(request_files, speed=3),
        "unknown behaviour": request(request_files, behaviour="flying"),
    }
    for expected, asked in bad.items():
        client = WorkerClient(asked)
        try:
            (error,) = of(MessageKind.ERROR, collect(client, lambda _, c=client: c.ended))
        finally:
            client.close()
        assert expected in str(error.error())


def children(process_id: int) -> list[int]:
    found = []
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            lines = status.read_text().splitlines()
        except OSError:
            continue
        if f"PPid:\t{process_id}" in lines:
            found.append(int(status.parent.name))
    return found


def is_running(process_id: int) -> bool:
    try:
        state = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="looks at /proc")
def test_no_process_is_left_when_another_dies(request_files: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "walk.perftake"
    client = WorkerClient({**request(request_files, loop=True), "take": str(path)})
    try:
        messages = collect(client, lambda m: len(of(MessageKind.POSE, m)) >= 5)
        (cameras,) = children(client._process.pid)
        os.kill(cameras, signal.SIGKILL)
        messages = collect(client, lambda _: client.ended, messages)
        (error,) = of(MessageKind.ERROR, messages)
        assert "ended by itself" in str(error.error())
    finally:
        client.close()
    take = read_take_file(path)
    assert take.complete
    assert [pack_solved(pose) for pose in take.poses] == [m.payload for m in of(MessageKind.POSE, messages)]
    assert "ended by itself" in take.events[-1]

    client = WorkerClient(request(request_files, loop=True))
    try:
        collect(client, lambda m: len(of(MessageKind.POSE, m)) >= 5)
        (cameras,) = children(client._process.pid)
        os.kill(client._process.pid, signal.SIGKILL)
        limit = time.monotonic() + PATIENCE_S
        while is_running(cameras):
            assert time.monotonic() < limit, "the cameras' process stays"
            time.sleep(0.1)
    finally:
        client.close()

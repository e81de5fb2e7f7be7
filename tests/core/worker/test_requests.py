"""Requests of missing keys and wrong types: one line of our own, and no job begins."""

import copy
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from perfanim.core.errors import CaptureError, PerfanimError, SettingsError
from perfanim.core.geometry.npz import write_arrays
from perfanim.core.worker import process
from perfanim.core.worker.jobs.camera_frames import _read_backgrounds
from perfanim.core.worker.requests import check_request
from perfanim.core.worker.restart_point import RestartPoint

SOURCE = {"kind": "simulated", "behaviour": "walking"}
AFTER = RestartPoint(3, 0.1, 5.0).table()
CAMERAS = {
    "source": SOURCE, "rig": None, "background_s": 2.0, "threshold": None, "in_flight": 2, "preview": True,
    "background_file": "/no/background.npz", "after": AFTER,
}  # fmt: skip
BOARD = {"source": {"kind": "videos", "paths": ["/no/a.mp4"]}, "board": "chessboard:9x6:80mm"}
POSE = {
    **CAMERAS, "marker_set": "boxing", "poses": ["t"], "countdown_s": 5, "between_s": 2.5, "seconds": 2.0,
    "out": "/no/take.npz", "floor_out": "/no/rig.toml",
}  # fmt: skip
SKETCH = {"skeleton": [{}], "database": "/no/a.pfdb", "sketch": {}, "settings": {}}
REQUESTS: dict[str, dict[str, Any]] = {
    "capture": {
        "cameras": CAMERAS, "performers": [{"marker_set": {}}], "props": [], "database": "/no/a.pfdb",
        "settings": {"method": "best"}, "take": "/no/a.perftake", "character": "", "vmc": [], "after": AFTER,
        "shape": {"smoothing_s": 0.1, "feet": "auto"}, "cause": "",
    },
    "cameras": CAMERAS,
    "trackers": {"source": {"kind": "vmc", "port": 39540, "sender": ""}, "marker_set": {}, "after": None},
    "command": {"arguments": ["take", "info"]},
    "record board": {**BOARD, "limit": 30, "every_s": None, "out": "/no"},
    "record floor": {**BOARD, "rig": {}},
    "record floor markers": {**CAMERAS, "height_m": 0.0, "longest_m": None},
    "record pose": POSE,
    "calibrate performer": {**POSE, "name": "Anna", "subject_out": "/no/a.toml"},
    "show cameras": {},
    "check setup": {**CAMERAS, "marker_set": "boxing", "countdown_s": 3.0, "fault": "", "ignored": [[0, 1.5, 2.0]]},
    "sketch": SKETCH,
    "sketch edit": {**SKETCH, "number": 3, "frame": 4.5},
}  # fmt: skip
WRONG: tuple[Any, ...] = (
    None,
    True,
    -1,
    1e300,
    float("nan"),
    "\0",
    "x",
    [],
    [3],
    [[]],
    {},
    {"kind": 3},
    {"number": "x"},
)


def test_each_job_has_a_request() -> None:
    assert set(REQUESTS) == {*process.JOBS, "sketch edit"}
    for job, request in REQUESTS.items():
        check_request(job, request)


@pytest.mark.parametrize(
    ("job", "change", "message"),
    [
        ("capture", {"cameras": None}, "request of the job capture: 'cameras' must be a table, it is missing; start"),
        ("capture", {"cameras": {}}, "'cameras.source' must be a table, it is missing"),
        ("capture", {"cameras": {"source": {}}}, "'cameras.source.kind' must be text, it is missing"),
        ("capture", {"performers": []}, r"'performers' must be a list of tables, it is \[\]"),
        ("capture", {"performers": [{"marker_set": 3}]}, "'performers.marker_set' must be a table, it is 3"),
        ("capture", {"vmc": ["localhost", 70_000]}, "'vmc' must be a host and a port"),
        (
            "capture",
            {"after": {**AFTER, "period_s": 0.0}},
            "'after.period_s' must be seconds from 1e-06 to 60, it is 0",
        ),
        ("cameras", {"background_s": float("nan")}, "'background_s' must be seconds from 0 to 3600, it is nan"),
        ("cameras", {"in_flight": True}, "'in_flight' must be a whole number from 0 to 1e.06, it is True"),
        ("cameras", {"background_file": "a\0"}, "'background_file' must be text"),
        ("record pose", {"poses": "t"}, "'poses' must be a list of texts, it is 't'"),
        ("check setup", {"ignored": [[0, 1]]}, "'ignored' must be a list of places"),
        ("sketch edit", {"number": None}, "'number' must be a whole number"),
    ],
)
def test_a_wrong_value_is_named(job: str, change: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        check_request(job, {**REQUESTS[job], **change})


class PlayedChannel:
    """Gives one request; keeps the error."""

    def __init__(self, request: dict[str, Any]) -> None:
        self.request, self.errors = request, []

    def wait_request(self) -> dict[str, Any]:
        return self.request

    def send_error(self, error: PerfanimError) -> None:
        self.errors.append(error)

    def close(self) -> None:
        """Say nothing."""


def changed(request: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for key in request:
        yield {other: value for other, value in request.items() if other != key}
        for value in WRONG:
            yield {**copy.deepcopy(request), key: value}


@pytest.mark.parametrize("job", process.JOBS)
def test_no_request_ends_a_worker_unexpectedly(job: str, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[dict[str, Any]] = []
    module = ModuleType("job")
    module.run = lambda request, channel: begun.append(request)  # type: ignore[attr-defined]
    monkeypatch.setattr(process, "_job", lambda name: module)
    refused = 0
    for request in changed(REQUESTS[job]):
        channel = PlayedChannel(request)
        monkeypatch.setattr(process, "Channel", lambda port, token, channel=channel: channel)
        status = process.main(0, "", job)
        assert [type(error) for error in channel.errors] == [SettingsError] * status
        refused += status
    assert refused >= len(REQUESTS[job])


def test_the_kept_backgrounds_are_read_without_trust(tmp_path: Any) -> None:
    path = tmp_path / "a.npz"
    write_arrays(path, {str(i): np.full((4, 6, 3), i + 1, np.float32) for i in range(4)}, packed=False)
    first, second = _read_backgrounds(path)
    assert (first.image_size, float(second.deviation.max())) == ((6, 4), 4.0)
    whole = path.read_bytes()
    for data in (whole[:300], b"", whole.replace(b"<f4", b"|O8")):
        path.write_bytes(data)
        with pytest.raises(CaptureError, match=r"a\.npz: "):
            _read_backgrounds(path)
    write_arrays(path, {"0": np.zeros((4, 6, 3)), "1": np.zeros((4, 5, 3))}, packed=False)
    with pytest.raises(CaptureError, match="a background has mean"):
        _read_backgrounds(path)


def test_a_worker_that_hears_nonsense_stops() -> None:
    program = (
        "import sys; from perfanim.core.worker.channel import Channel\n"
        "stopped = Channel(int(sys.argv[1]), '').stop_requested.wait(60)\n"
        "print(stopped, flush=True)\n"
    )
    with socket.create_server(("127.0.0.1", 0)) as listener:
        line = [sys.executable, "-c", program, str(listener.getsockname()[1])]
        with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=os.environ) as worker:
            connection, _ = listener.accept()
            with connection:
                connection.sendall(b"GET / HTTP/1.1\r\n\r\n")
                assert worker.stdout is not None
                assert worker.stdout.readline() == "True\n"
            worker.kill()

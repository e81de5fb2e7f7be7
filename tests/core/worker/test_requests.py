"""Requests of missing keys and wrong types: one line of our own, and no job begins."""

import copy
import json
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import MOST_TEXT, CaptureError, PerfanimError
from perfanim.core.geometry.npz import write_arrays
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.prop import load_prop
from perfanim.core.markers.subject import Subject, subject_tables
from perfanim.core.session.pose_filters import FilterSettings
from perfanim.core.simulate.studio.simulated_performer import SimulatedPerformer
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.sources.source_requests import VideoFiles
from perfanim.core.worker import process
from perfanim.core.worker.jobs.camera_frames import _read_backgrounds
from perfanim.core.worker.requests import (
    CalibratePerformerRequest,
    CamerasRequest,
    CaptureRequest,
    CheckSetupRequest,
    CommandRequest,
    FloorMarkersRequest,
    RecordBoardRequest,
    RecordFloorRequest,
    RecordPoseRequest,
    RecordWalkRequest,
    ShowCamerasRequest,
    SketchEdit,
    SketchRequest,
    TrackerSource,
    TrackersRequest,
    VmcTarget,
    read_request,
)
from perfanim.core.worker.restart_point import RestartPoint

SOURCE = SimulatedPerformer(behaviour="walking")
AFTER = RestartPoint(3, 0.1, 5.0)
CAMERAS: dict[str, Any] = {
    "source": SOURCE, "rig": None, "background_s": 2.0, "threshold": None, "in_flight": 2, "preview": True,
    "background_file": "/no/background.npz", "after": AFTER,
}  # fmt: skip
RIG = default_rig()
SUBJECT = Subject("Anna", default_skeleton(), load_marker_set("boxing"), 0.002)
BOARD: dict[str, Any] = {"source": VideoFiles(("/no/a.mp4",)), "board": "chessboard:9x6:80mm"}
POSE = {
    **CAMERAS, "marker_set": "boxing", "poses": ("t",), "countdown_s": 5.0, "between_s": 2.5, "seconds": 2.0,
    "out": "/no/take.npz", "floor_out": "/no/rig.toml",
}  # fmt: skip
EDIT: dict[str, Any] = {"sketch": {}, "settings": {}, "number": 3, "frame": 4.5}
ASKED = (
    CaptureRequest(
        cameras=CamerasRequest(**CAMERAS), performers=(SUBJECT,), props=(load_prop("sword"),), database="/no/a.pfdb",
        settings={"method": "best"}, take="/no/a.perftake", vmc=VmcTarget("localhost", 39539), after=AFTER,
        shape=FilterSettings(0.1, "auto"),
    ),
    CamerasRequest(**CAMERAS),
    TrackersRequest(source=TrackerSource(39540), marker_set=SUBJECT.marker_set),
    CommandRequest(arguments=("take", "info")),
    RecordBoardRequest(**BOARD, limit=30, every_s=None, out="/no"),
    RecordFloorRequest(**BOARD, rig=RIG),
    FloorMarkersRequest(**{**CAMERAS, "rig": RIG}, height_m=0.1, longest_m=None),
    RecordPoseRequest(**POSE),
    RecordWalkRequest(**CAMERAS, countdown_s=3.0, seconds=20.0, height_m=1.75),
    CalibratePerformerRequest(**POSE, name="Anna", subject_out="/no/a.toml"),
    ShowCamerasRequest(),
    CheckSetupRequest(**CAMERAS, marker_set="boxing", countdown_s=3.0, ignored=((0, 1.5, 2.0),)),
    SketchRequest(skeleton=default_skeleton(), database="/no/a.pfdb", **EDIT),
    SketchEdit(**EDIT),
)  # fmt: skip
REQUESTS: dict[str, dict[str, Any]] = {each.job: json.loads(json.dumps(each.to_json())) for each in ASKED}
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
    for asked in ASKED:
        read = read_request(asked.job, REQUESTS[asked.job])
        assert type(read) is type(asked) and read.to_json() == asked.to_json()


def test_what_is_left_out_is_as_by_default() -> None:
    read = read_request("capture", {"cameras": {"source": {"kind": "cameras", "devices": [0, "rtsp://a/b"]}},
        "performers": [subject_tables(SUBJECT)], "database": "a.pfdb", "later": 3})  # fmt: skip
    assert (read.cameras.background_s, read.cameras.source.devices) == (2.0, (0, "rtsp://a/b"))
    assert (read.shape, read.vmc, read.props) == (FilterSettings(), None, ())


@pytest.mark.parametrize(
    ("job", "change", "message"),
    [
        ("capture", {"cameras": None}, r"request of the job capture: lacks 'cameras', a table \[cameras\]; start it"),
        ("capture", {"cameras": {}}, r"request of the job capture, cameras: lacks 'source', a table \[source\]"),
        ("capture", {"cameras": {"source": {}}}, "capture, cameras, source: kind must be one of simulated, videos"),
        ("capture", {"cameras": {"source": {"kind": []}}}, "capture, cameras, source: kind must be one of simulated"),
        ("capture", {"performers": []}, r"performers must be a list of 1 or more tables \[\[performers\]\]"),
        ("capture", {"performers": [{"marker_set": 3}]}, "capture, performers 1: lacks 'name', a string"),
        ("capture", {"vmc": {"host": "localhost", "port": 70_000}}, "port must be a whole number from 0 to 65,535"),
        ("capture", {"after": {**REQUESTS["capture"]["after"], "period_s": 0.0}}, "period_s must be a number from 1e"),
        ("cameras", {"background_s": float("nan")}, "background_s must be a number from 0 to 3,600 s"),
        ("cameras", {"in_flight": True}, "in_flight must be a whole number from 0 to 1,000,000"),
        ("cameras", {"background_file": "a\0"}, "background_file must be a string"),
        ("cameras", {"rig": {"cam_0": {"size": 3}}}, "cam_0: lacks 'matrix'|cam_0: size must be two whole numbers"),
        ("record pose", {"poses": "t"}, "poses must be a list of strings"),
        ("check setup", {"ignored": [[0, 1]]}, "ignored must be a list of rows of three numbers"),
        ("sketch edit", {"number": -1}, "number must be a whole number from 0"),
    ],
)
def test_a_wrong_value_is_named(job: str, change: dict[str, Any], message: str) -> None:
    with pytest.raises(PerfanimError, match=message) as refused:
        read_request(job, {**REQUESTS[job], **change})
    assert len(str(refused.value)) <= MOST_TEXT and str(refused.value).isprintable()


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
        assert len(channel.errors) == status and all(isinstance(error, PerfanimError) for error in channel.errors)
        assert not any("unexpectedly" in str(error) for error in channel.errors)
        refused += status
    assert refused >= len(REQUESTS[job]) - 1  # the job's name


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
    with pytest.raises(CaptureError, match="are not colour images of the same size"):
        _read_backgrounds(path)

import struct
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.markers.marker_frame import MarkerFrame, undistort_blobs
from perfanim.core.markers.marker_frame_codec import pack, unpack
from perfanim.core.markers.marker_frame_subset import without_blobs
from perfanim.core.simulate.studio.studio_rig import default_rig

ARRAYS = ("points_m", "covariances_m2", "labels", "point_blobs", "single_cameras", "single_blobs", "single_points",
          "single_labels")  # fmt: skip


def full() -> MarkerFrame:
    generator = np.random.default_rng(0)
    left, right = generator.normal(size=(5, 5)).astype(np.float32), np.empty((0, 5), dtype=np.float32)
    return MarkerFrame(
        number=-(2**40),
        time_s=12.345678901234,
        points_m=generator.normal(size=(4, 3)),
        covariances_m2=generator.normal(size=(4, 3, 3)),
        labels=np.array([3, -1, 0, 1]),
        blobs=(left, right),
        detected=(left + np.float32(0.25), right),
        point_blobs=generator.integers(-1, 5, (4, 2)),
        single_cameras=np.array([0, 1]),
        single_blobs=np.array([4, 2]),
        single_points=generator.normal(size=(2, 2)),
        single_labels=np.array([-1, 7]),
        notes=("left camera frozen", "Überbelichtet"),
    )


def assert_same(a: MarkerFrame, b: MarkerFrame) -> None:
    assert (a.number, a.time_s, a.notes) == (b.number, b.time_s, b.notes)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert len(a.normalised) == len(b.normalised)
    for mine, theirs in zip(a.normalised, b.normalised, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert len(a.blobs) == len(b.blobs)
    for mine, theirs in zip(a.blobs + a.detected, b.blobs + b.detected, strict=True):
        np.testing.assert_array_equal(mine, theirs)
        assert mine.dtype == theirs.dtype


def undistorted() -> MarkerFrame:
    return replace(full(), normalised=(np.random.default_rng(1).normal(size=(5, 2)), np.empty((0, 2))))


@pytest.mark.parametrize(
    "frame", [full(), undistorted(), MarkerFrame(0, 0.0), MarkerFrame(3, 0.1, notes=("only a note",))]
)
def test_round_trip(frame: MarkerFrame) -> None:
    assert_same(unpack(pack(frame)), frame)


def test_frames_of_version_3_are_read() -> None:
    """They had no counts of normalised coordinates, nor these."""
    data, header = pack(full()), struct.Struct("<4sHHqdIIII")
    fields = list(header.unpack_from(data))
    fields[1], fields[-1] = 3, fields[-1] - 8
    assert_same(unpack(header.pack(*fields) + data[header.size : header.size + 16] + data[header.size + 24 :]), full())


def test_blobs_are_undistorted_once() -> None:
    cameras = default_rig().cameras
    frame = MarkerFrame(0, 0.0, blobs=tuple(np.full((2, 5), 100.0, dtype=np.float32) for _ in cameras))
    known = undistort_blobs(frame, cameras)
    for camera, rows in zip(cameras, known.normalised, strict=True):
        np.testing.assert_allclose(camera.to_pixels(rows), 100.0, atol=1e-9)
    assert undistort_blobs(known, cameras) is known
    kept = without_blobs(known, [np.array([0]), np.array([], dtype=np.int64)])
    np.testing.assert_array_equal(kept.normalised[0], known.normalised[0][1:])


def test_truncated_frames_are_refused() -> None:
    data = pack(full())
    for length in range(len(data)):
        with pytest.raises(CaptureError, match="cut off"):
            unpack(data[:length])
    with pytest.raises(CaptureError, match="cut off"):
        unpack(data + b"\0")


def test_another_version_is_refused_with_advice() -> None:
    data = bytearray(pack(full()))
    for position in (0, 4):
        changed = data.copy()
        changed[position] ^= 1
        with pytest.raises(CaptureError, match="another version of Perfanim; restart Blender"):
            unpack(bytes(changed))


def test_changed_bytes_are_refused_or_give_another_frame() -> None:
    data = pack(full())
    for position in range(len(data)):
        for bit in (0x01, 0x80, 0xFF):
            changed = bytearray(data)
            changed[position] ^= bit
            try:
                frame = unpack(bytes(changed))
            except CaptureError:
                continue
            assert (len(frame.points_m), len(frame.blobs)) == (4, 2)


def test_impossible_counts_are_refused() -> None:
    header = bytearray(pack(full())[: struct.calcsize("<4sHHqdIIII")])
    struct.pack_into("<II", header, 24, 2**32 - 1, 2**32 - 1)
    struct.pack_into("<H", header, 6, 2**16 - 1)
    with pytest.raises(CaptureError, match="cut off"):
        unpack(bytes(header) + b"\0" * 300_000)


def test_labels_are_unknown_when_not_given() -> None:
    frame = MarkerFrame(0, 0.0, np.zeros((2, 3)), np.zeros((2, 3, 3)), single_cameras=np.array([0]),
                        single_blobs=np.array([0]), single_points=np.zeros((1, 2)),
                        blobs=(np.zeros((1, 5), dtype=np.float32),))  # fmt: skip
    np.testing.assert_array_equal(frame.labels, [-1, -1])
    np.testing.assert_array_equal(frame.single_labels, [-1])
    np.testing.assert_array_equal(frame.point_blobs, [[-1], [-1]])


@pytest.mark.parametrize(
    "change",
    [
        {"points_m": np.zeros((4, 2))},
        {"covariances_m2": np.zeros((3, 3, 3))},
        {"labels": np.zeros(5, dtype=np.int64)},
        {"point_blobs": np.zeros((4, 3), dtype=np.int64)},
        {"single_blobs": np.zeros(1, dtype=np.int64)},
        {"single_points": np.zeros((2, 3))},
    ],
)
def test_inconsistent_frames_are_refused(change: dict[str, np.ndarray]) -> None:
    parts = {name: getattr(full(), name) for name in (*ARRAYS, "blobs")}
    with pytest.raises(CaptureError, match=rf"frame 8: {next(iter(change))} has shape"):
        MarkerFrame(8, 0.0, **(parts | change))

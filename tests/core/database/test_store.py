import hashlib
import json
import os
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench.subset import write_database
from perfanim.core.body.joint_angle_frames import with_angle_frames
from perfanim.core.body.standard_skeleton import default_skeleton, scaled
from perfanim.core.database import store
from perfanim.core.database.store import (
    Clip,
    Database,
    check_arrays,
    check_file,
    open_database,
    pose_from_rotations,
    rotations_from_pose,
)
from perfanim.core.errors import DatabaseError
from perfanim.core.geometry import rotations as rot

FRAMES = 50
CLIPS = (Clip("a.bvh", "walk", "1", 120.0, 0, 30, 0), Clip("b.bvh", "run", "2", 60.0, 30, 50, 1))
SKELETONS = (default_skeleton(), with_angle_frames(scaled(default_skeleton(), 1.1)))


def motion(frames: int = FRAMES) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(0)
    usual = generator.normal(scale=1.0, size=(29, 3))
    vectors = generator.normal(scale=0.4, size=(frames, 29, 3))
    rotations = rot.multiply(rot.from_rotation_vector(usual), rot.from_rotation_vector(vectors))
    return rotations, generator.normal(size=(frames, 3))


@pytest.fixture
def written(tmp_path: Path) -> Path:
    write_database(tmp_path / "m.db", 60.0, *motion(), CLIPS, SKELETONS)
    return tmp_path / "m.db"


def test_round_trip(written: Path) -> None:
    database = open_database(written)
    rotations, positions = motion()
    # float32 rotation vectors of about 1 rad: 1e-7 rad each
    assert rot.angle_between(database.local_rotations(slice(None)), rotations).max() < 1e-6
    np.testing.assert_array_equal(database.root_positions_m, positions.astype(np.float32))
    assert (database.fps, database.frames, database.clips) == (60.0, FRAMES, CLIPS)
    assert database.behaviours == {"walk": 30, "run": 20}
    np.testing.assert_array_equal(database.clip_of_frame, [0] * 30 + [1] * 20)
    for mine, theirs in zip(database.skeletons, SKELETONS, strict=True):
        assert mine.angle_orders == theirs.angle_orders
        for name in ("parents", "offsets_m", "tips_m", "angle_axes"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))
    assert [path.name for path in written.parent.iterdir()] == ["m.db"]


def test_a_file_that_is_cut_off_while_it_is_mapped_is_told(written: Path) -> None:
    database = open_database(written)
    check_file(database)
    os.truncate(written, written.stat().st_size - 100)
    with pytest.raises(DatabaseError, match="is cut off"):
        check_file(database)


def test_a_file_that_is_replaced_or_removed_stays_mapped(written: Path) -> None:
    database = open_database(written)
    poses = np.array(database.poses)
    write_database(written, 60.0, *motion(), CLIPS, SKELETONS)
    check_file(database)
    written.unlink()
    check_file(database)
    np.testing.assert_array_equal(database.poses, poses)


def test_arrays_are_mapped_and_cannot_be_changed(written: Path) -> None:
    database = open_database(written)
    for array in (database.poses, database.root_rotations, database.root_positions_m):
        assert isinstance(array, np.memmap)
        assert array.ctypes.data % 64 == 0
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_poses_and_rotations_are_inverse() -> None:
    rotations, _ = motion()
    mean = rot.mean(rotations)
    poses = pose_from_rotations(rotations, mean)
    assert poses.shape == (FRAMES, 28, 3)
    again = rotations_from_pose(poses, mean, rotations[:, 0])
    assert rot.angle_between(again, rotations).max() < 1e-7
    assert np.linalg.norm(poses.mean(axis=0), axis=1).max() < 0.4  # relative to the mean they scatter about zero


def test_a_file_cut_off_at_any_byte_is_refused_with_advice(tmp_path: Path) -> None:
    written, clip = tmp_path / "small.db", Clip("a.bvh", "walk", "1", 120.0, 0, 4, 0)
    write_database(written, 60.0, *motion(4), (clip,), SKELETONS[:1])
    whole = written.stat().st_size
    with written.open("r+b") as stream:
        for length in range(whole - 1, -1, -1):
            stream.truncate(length)
            with pytest.raises(DatabaseError) as caught:
                open_database(written)
            assert str(caught.value).startswith(f"{written}: is "), length
            assert "build it again" in str(caught.value), length


def test_a_file_that_is_too_long_is_refused(written: Path) -> None:
    written.write_bytes(written.read_bytes() + b"more")
    with pytest.raises(DatabaseError, match="build it again"):
        open_database(written)


def test_a_changed_header_is_refused(written: Path) -> None:
    whole = written.read_bytes()
    header_bytes = int.from_bytes(whole[16:24], "little")
    changed_file = written.with_name("changed.db")
    positions = [*range(64), *np.linspace(64, 64 + header_bytes - 1, 60).astype(int)]
    for position in positions:
        changed = bytearray(whole)
        changed[position] ^= 0x41
        changed_file.write_bytes(changed)
        with pytest.raises(DatabaseError, match=r"changed\.db: .*; build it again"):
            open_database(changed_file)


def test_parts_that_do_not_fit_are_refused_without_a_file(tmp_path: Path) -> None:
    rotations, positions = motion()
    path = tmp_path / "m.db"
    with pytest.raises(DatabaseError, match="no motion to store"):
        write_database(path, 60.0, rotations[:0], positions[:0], (), SKELETONS)
    wrong_clips = [CLIPS[:1], CLIPS[1:], CLIPS[::-1], (CLIPS[0], replace(CLIPS[1], stop=49)),
                   (CLIPS[0], replace(CLIPS[1], skeleton=2))]  # fmt: skip
    for clips in wrong_clips:
        with pytest.raises(DatabaseError, match=r"m\.db: "):
            write_database(path, 60.0, rotations, positions, clips, SKELETONS)
    with pytest.raises(DatabaseError, match="root positions"):
        write_database(path, 60.0, rotations, positions[:-1], CLIPS, SKELETONS)
    with pytest.raises(DatabaseError):
        write_database(path, 60.0, rotations[:, :5], positions, CLIPS, SKELETONS)
    assert not any(tmp_path.iterdir())


def test_a_database_is_replaced_as_a_whole(written: Path) -> None:
    opened = open_database(written)
    before = np.array(opened.poses)
    rotations, positions = motion(10)
    write_database(written, 30.0, rotations, positions, (Clip("c", "", "", 30.0, 0, 10, 0),), SKELETONS[:1])
    np.testing.assert_array_equal(opened.poses, before)  # who has the old one open keeps it
    database: Database = open_database(written)
    assert (database.frames, database.fps) == (10, 30.0)


def _with_facts(path: Path, change) -> None:
    """Change the header of a file and make its digest and lengths right again."""
    data = path.read_bytes()
    _, version, length, _, _ = store._PREAMBLE.unpack(data[: store._PREAMBLE.size])
    facts = json.loads(data[store._PREAMBLE.size : store._PREAMBLE.size + length])
    start = store._PREAMBLE.size + length
    arrays = data[start + -start % 64 :]
    change(facts)
    header = json.dumps(facts).encode()
    start = store._PREAMBLE.size + len(header)
    start += -start % 64
    digest = hashlib.sha256(header).digest()
    preamble = store._PREAMBLE.pack(store._MAGIC, version, len(header), start + len(arrays), digest)
    path.write_bytes((preamble + header).ljust(start, b"\0") + arrays)


def _with_fact(path: Path, place: tuple[Any, ...], value: Any) -> None:
    """Change one fact of the header, found by the keys of the tables above it."""

    def change(facts: Any) -> None:
        for key in place[:-1]:
            facts = facts[key]
        facts[place[-1]] = value

    _with_facts(path, change)


WRONG = [None, "text", 3, -1, 1e400, float("nan"), [], {}, [[]], [None], "9" * 9999, [[[]]], {"a": 1}]


@pytest.mark.parametrize("value", WRONG, ids=[str(value)[:9] for value in WRONG])
def test_facts_of_wrong_type_are_refused(written: Path, value) -> None:
    whole = written.read_bytes()
    places = [(key,) for key in ("fps", "joints", "clips", "skeletons", "arrays")]
    places += [("clips", 0, key) for key in ("start", "stop", "skeleton", "source_fps")]
    places += [("skeletons", 0, key) for key in ("offsets_m", "tips_m", "angle_axes", "parents")]
    places += [("arrays", "poses", key) for key in ("dtype", "shape", "offset")]
    places += [("arrays", "poses"), ("clips", 0), ("skeletons", 1)]
    harmless = 0
    for place in places:
        written.write_bytes(whole)
        _with_fact(written, place, value)
        try:
            open_database(written)
            harmless += 1
        except DatabaseError as error:
            assert len(str(error)) <= 300
    assert harmless <= 3  # a rate of 3, of the database or of a file, and -1 or 3 for a body that there is


def test_a_list_as_a_number_of_rows_takes_no_memory(written: Path) -> None:
    """numpy multiplies it, which repeats it."""
    _with_facts(written, lambda facts: facts["arrays"]["poses"].update(shape=[[0] * 1000, 3000, 3]))
    tracemalloc.start()
    try:
        with pytest.raises(DatabaseError, match="poses: shape must be a list of whole numbers from 0"):
            open_database(written)
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()


def test_arrays_elsewhere_or_of_other_types_are_refused(written: Path) -> None:
    whole = written.read_bytes()
    for change in (
        {"offset": 1 << 40}, {"offset": -64}, {"dtype": "<f8"}, {"dtype": "|O"}, {"shape": [FRAMES + 1000, 28, 3]},
        {"shape": [10**15, 28, 3]}, {"shape": [FRAMES, 29, 3]}, {"shape": [FRAMES - 1, 28, 3]},
    ):  # fmt: skip
        written.write_bytes(whole)
        _with_facts(written, lambda facts, change=change: facts["arrays"]["poses"].update(change))
        with pytest.raises(DatabaseError):
            open_database(written)
    written.write_bytes(whole)
    _with_facts(written, lambda facts: facts["arrays"].update(more=facts["arrays"]["poses"]))
    with pytest.raises(DatabaseError):
        open_database(written)


def test_numbers_that_are_no_poses_are_refused_before_a_solve(written: Path) -> None:
    check_arrays(open_database(written))
    for name, value in (
        ("poses", np.nan), ("poses", 1e30), ("root_positions_m", -np.inf), ("root_rotations", 0.0),
        ("root_rotations", np.nan),
    ):  # fmt: skip
        database = open_database(written)
        array = np.array(getattr(database, name))
        array.reshape(len(array), -1)[FRAMES // 2] = value
        with pytest.raises(DatabaseError, match="contains invalid poses"):
            check_arrays(replace(database, **{name: array}))


def test_a_changed_bit_is_found_before_a_solve(written: Path) -> None:
    content = written.read_bytes()
    for name in ("poses", "root_rotations", "root_positions_m"):
        damaged = bytearray(content)
        damaged[getattr(open_database(written), name).offset] ^= 1  # of the lowest byte: still a pose
        written.write_bytes(damaged)
        with pytest.raises(DatabaseError, match=f"is damaged: its {name} have changed"):
            check_arrays(open_database(written))
        written.write_bytes(content)
    check_arrays(open_database(written))


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("fps",), 3000, "fps must be a number from 1 to 2,000 frames per second"),
        (("clips", 0, "source_fps"), float("nan"), "source_fps must be a number from 0.001"),
        (("clips", 0, "start"), True, "start must be a whole number from 0"),
        (("clips", 0, "mirrored"), "no", "mirrored must be true or false"),
        (("skeletons", 0, "offsets_m"), [[0.0, 0.0, 11.0]] * 29, "offsets_m must be 29 x 3 numbers from -10 to 10 m"),
        (("skeletons", 0, "parents"), [29] * 29, "parents must be 29 whole numbers from -1 to 28"),
        (("arrays", "poses", "crc32"), -1, "poses: crc32 must be a whole number from 0 to 4,294,967,295"),
        (("zeros",), [["a", 0]], "zeros 1: lacks 'mirrored', true or false"),
        (("zeros",), [3], "zeros must be a list of tables"),
        (("culled_frames",), float("inf"), "culled_frames must be a whole number from 0"),
    ],
)
def test_a_fact_out_of_range_is_named(written: Path, place, value, message) -> None:
    _with_fact(written, place, value)
    with pytest.raises(DatabaseError) as caught:
        open_database(written)
    assert message in str(caught.value) and len(str(caught.value)) <= 300

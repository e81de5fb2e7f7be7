import numpy as np
import pytest
from bench.subset import write_database
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.cells import SETTINGS, build_cells
from perfanim.core.database.store import Clip, check_arrays, open_database
from perfanim.core.errors import DatabaseError
from perfanim.core.geometry import rotations as rot


def motion(frames):
    """Return local rotations (F, 29, 4) and a clip of a body that does two things, over and over."""
    generator = np.random.default_rng(0)
    ways = generator.normal(scale=0.3, size=(2, 28, 3))
    vectors = np.sin(0.05 * np.arange(frames))[:, None, None] * np.repeat(ways, frames // 2, axis=0)
    rotations = np.broadcast_to(rot.identity(), (frames, 29, 4)).copy()
    rotations[:, 1:] = rot.from_rotation_vector(vectors)
    return rotations, [Clip("a", "walk", "1", 60.0, 0, frames, 0)]


def written(path, frames):
    rotations, clips = motion(frames)
    write_database(path, 60.0, rotations, np.zeros((frames, 3)), clips, [default_skeleton()])
    return open_database(path)


def test_frames_of_a_cell_are_alike(tmp_path):
    database = written(tmp_path / "small.pfdb", 4000)
    cells = build_cells(database.poses, database.mean_rotations)
    counts = np.bincount(cells)
    assert counts.min() > 0
    assert len(counts) == pytest.approx(4.0 * np.sqrt(4000), rel=0.3)
    poses = database.poses.reshape(4000, -1)
    within = [poses[cells == cell].std(axis=0).mean() for cell in range(len(counts))]
    assert np.mean(within) < 0.1 * poses.std(axis=0).mean()


def test_a_large_database_is_stored_with_its_cells(tmp_path):
    assert written(tmp_path / "small.pfdb", 200).cells is None
    large = written(tmp_path / "large.pfdb", SETTINGS.least_frames)
    assert isinstance(large.cells, np.memmap)
    versions = [path.read_bytes()[12] for path in (tmp_path / "small.pfdb", large.path)]
    assert versions == [2, 3]  # older programs say so, and not that the file is damaged
    np.testing.assert_array_equal(large.cells, build_cells(large.poses, large.mean_rotations))


def test_changed_cells_are_refused(tmp_path):
    path = tmp_path / "large.pfdb"
    cells = np.array(written(path, SETTINGS.least_frames).cells)
    data, wrong = path.read_bytes(), cells.copy()
    wrong[7] = SETTINGS.least_frames
    path.write_bytes(data.replace(cells.tobytes(), wrong.tobytes()))
    with pytest.raises(DatabaseError, match="cells have changed"):
        check_arrays(open_database(path))

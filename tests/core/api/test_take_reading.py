"""Takes and performers as scripts read them: axes, labels and marker sets of any file."""

from dataclasses import replace

import numpy as np
import perfanim
import pytest
from perfanim.core.formats.markers.marker_files import read_take, write_take
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.markers.marker_set import Marker, MarkerSet, load_marker_set
from perfanim.core.markers.subject import save_subject
from perfanim.core.simulate.simulated_markers import simulate_markers
from vicon_file import write_vicon_file


@pytest.fixture
def take(truth, subject):
    return simulate_markers(truth, subject)[0]


def test_vicon_file_comes_upright_and_under_the_names_of_its_set(take, tmp_path):
    write_vicon_file(take, tmp_path / "walk.c3d")
    read = perfanim.load_take(tmp_path / "walk.c3d")
    assert read.names == take.names  # locomotion, found by its labels
    np.testing.assert_allclose(read.positions_m, take.positions_m, atol=1e-5)
    for marker_set in ("locomotion", load_marker_set("locomotion")):
        named = perfanim.load_take(tmp_path / "walk.c3d", marker_set, up="z")
        np.testing.assert_allclose(named.positions_m, take.positions_m, atol=1e-5)


def test_axes_are_kept_on_request(take, tmp_path):
    write_vicon_file(take, tmp_path / "walk.c3d")
    kept = perfanim.load_take(tmp_path / "walk.c3d", up=None)
    np.testing.assert_allclose(kept.positions_m[..., 2], take.positions_m[..., 1], atol=1e-5)


def test_floor_below_the_feet_becomes_zero(truth, tmp_path):
    suited = simulate_markers(truth, load_marker_set("cmu-41"))[0]
    write_vicon_file(replace(suited, positions_m=suited.positions_m + np.array([0.0, 0.7, 0.0])), tmp_path / "high.c3d")
    level = perfanim.load_take(tmp_path / "high.c3d", up="feet")
    assert abs(np.nanmin(level.positions_m[..., 1]) - np.nanmin(suited.positions_m[..., 1])) < 0.05


def test_names_are_given_as_a_table_or_a_file(take, tmp_path):
    labels = {f"P{number}": name for number, name in enumerate(take.names)}
    write_take(replace(take, names=tuple(labels)), tmp_path / "walk.trc")
    with pytest.raises(perfanim.PerfanimError, match="any shipped marker set; choose the marker set that was worn"):
        perfanim.load_take(tmp_path / "walk.trc")
    lines = "".join(f'"{label}" = "{name}"\n' for label, name in labels.items())
    (tmp_path / "names.toml").write_text(f"[names]\n{lines}")
    for names in (labels, tmp_path / "names.toml"):
        assert perfanim.load_take(tmp_path / "walk.trc", names=names).names == take.names


def test_recorded_take_is_returned_as_it_is(take, subject, database, tmp_path):
    perfanim.solve(take, subject, database, perfanim.SolveRequest("nearest", causal=True)).save(tmp_path / "a.perftake")
    again = perfanim.load_take(tmp_path / "a.perftake", up="z")
    np.testing.assert_array_equal(again.positions_m, read_take(tmp_path / "a.perftake").positions_m)


def test_subject_is_a_calibrated_one_or_a_skeleton_with_a_marker_set(truth, subject, tmp_path):
    save_subject(subject, tmp_path / "walker.toml")
    write_bvh(truth, tmp_path / "walker.bvh")
    assert perfanim.load_subject(tmp_path / "walker.toml").marker_set.names == subject.marker_set.names
    bare = perfanim.load_subject(tmp_path / "walker.bvh", "locomotion")
    assert (bare.name, bare.marker_set.names) == ("walker", subject.marker_set.names)
    np.testing.assert_allclose(bare.skeleton.offsets_m, subject.skeleton.offsets_m, atol=1e-5)
    with pytest.raises(
        perfanim.PerfanimError, match=r"walker\.bvh: a skeleton carries no markers; name the marker set"
    ):
        perfanim.load_subject(tmp_path / "walker.bvh")


def test_marker_without_a_calibrated_place_is_at_its_usual_one_or_refused(subject, tmp_path):
    save_subject(subject, tmp_path / "walker.toml")
    more = load_marker_set("boxing")
    worn = perfanim.load_subject(tmp_path / "walker.toml", more).marker_set
    assert worn.names == more.names
    unplaced = MarkerSet("own", (*more.markers, Marker("EXTRA", "head")))
    with pytest.raises(perfanim.PerfanimError, match="no offset is known for EXTRA; calibrate the subject"):
        perfanim.load_subject(tmp_path / "walker.toml", unplaced)

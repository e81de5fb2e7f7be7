from copy import deepcopy
from functools import reduce
from operator import getitem
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.body.joint_angle_frames import with_angle_frames
from perfanim.core.body.standard_skeleton import default_skeleton, scaled
from perfanim.core.errors import MarkerSetError, PerfanimError, SkeletonError
from perfanim.core.markers.marker_set import Marker, MarkerSet, load_marker_set, marker_set_names
from perfanim.core.markers.subject import Subject, load_subject, save_subject
from perfanim.core.system.files import read_toml, write_toml


@pytest.mark.parametrize("name", marker_set_names())
def test_shipped_sets_fit_the_standard_skeleton(name: str) -> None:
    marker_set = load_marker_set(name)
    assert marker_set.name == name
    assert marker_set.torso.sum() >= 3
    assert len(marker_set.joint_indices(default_skeleton())) == len(marker_set)
    # nothing is worn further from its joint than the kendo sword's marker
    assert np.linalg.norm(marker_set.offsets_m, axis=1).max() < 0.7


def test_locomotion_is_hands_feet_shoulders_and_waist() -> None:
    assert "locomotion" in marker_set_names()
    names = load_marker_set("locomotion").names
    assert sorted(names) == ["LFOO", "LHAN", "LSHO", "LWAI", "RFOO", "RHAN", "RSHO", "RWAI"]
    assert set(load_marker_set("boxing").names) - set(names) == {"HEAD"}


def test_set_is_read_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("".join(f'[[marker]]\nname = "M{i}"\njoint = "root"\ntorso = true\n' for i in range(3)))
    marker_set = load_marker_set(path)
    assert (marker_set.name, marker_set.names) == ("mine", ("M0", "M1", "M2"))
    with pytest.raises(MarkerSetError, match="no offset for M0, M1, M2; calibrate the subject"):
        _ = marker_set.offsets_m


def test_offsets_and_subset() -> None:
    marker_set = load_marker_set("locomotion")
    moved = marker_set.with_offsets(np.arange(24.0).reshape(8, 3) / 4.0)
    assert moved.markers[1].offset_m == (0.75, 1.0, 1.25)
    assert moved.names == marker_set.names
    few = marker_set.subset(["RWAI", "LSHO", "RSHO"])
    assert few.names == ("LSHO", "RSHO", "RWAI")


def test_bad_offsets_and_names_are_refused() -> None:
    markers = [Marker(name, "root", (0.0, 0.0, 0.0), True) for name in "ABC"]
    for value in (np.inf, np.nan, -12.0):
        with pytest.raises(
            MarkerSetError, match="marker D: offset_m must be three numbers below 10; give it in metres"
        ):
            MarkerSet("a", (*markers, Marker("D", "root", (0.0, value, 0.0))))
    with pytest.raises(MarkerSetError, match=r"no marker set or file 'dancing'; shipped sets: blazepose-33, .*boxing"):
        load_marker_set("dancing")
    with pytest.raises(SkeletonError, match="no joint 'tail'"):
        Subject("a", default_skeleton(), MarkerSet("a", (*markers, Marker("D", "tail", (0.0, 0.0, 0.0)))))


def test_texts_default_to_names(tmp_path: Path) -> None:
    assert load_marker_set("boxing").texts[-2:] == ("left foot", "right foot")
    assert [marker.name for marker in load_marker_set("kendo").markers if not marker.text] == []
    assert MarkerSet("a", tuple(Marker(name, "root", torso=True) for name in "ABC")).texts == ("A", "B", "C")


def test_subject_round_trip(tmp_path: Path) -> None:
    skeleton = with_angle_frames(scaled(default_skeleton(), np.linspace(0.9, 1.1, 29)))
    subject = Subject('Ann "A"', skeleton, load_marker_set("boxing"), 0.00213)
    save_subject(subject, tmp_path / "s.toml")
    again = load_subject(tmp_path / "s.toml")
    assert (again.name, again.residual_m, again.marker_set) == (subject.name, subject.residual_m, subject.marker_set)
    assert (again.skeleton.names, again.skeleton.angle_orders) == (skeleton.names, skeleton.angle_orders)
    for name in ("parents", "offsets_m", "tips_m", "angle_axes"):
        np.testing.assert_array_equal(getattr(again.skeleton, name), getattr(skeleton, name))
    assert [path.name for path in tmp_path.iterdir()] == ["s.toml"]


def test_incomplete_subject_files_are_refused(tmp_path: Path) -> None:
    save_subject(Subject("a", default_skeleton(), load_marker_set("locomotion")), tmp_path / "s.toml")
    places = [(), ("joint", 0), ("joint", 28), ("marker_set", "marker", 0)]
    for place in places:
        whole = read_toml(tmp_path / "s.toml")
        for key in reduce(getitem, place, whole):
            if key in ("torso", "text") and place:
                continue  # false and empty when they are not there
            broken = deepcopy(whole)
            del reduce(getitem, place, broken)[key]
            write_toml(tmp_path / "b.toml", broken)
            with pytest.raises(PerfanimError):
                load_subject(tmp_path / "b.toml")


def test_markers_next_to_the_torso_stand_in_for_it():
    suit = load_marker_set("plug-in-gait")
    few = suit.worn(["LASI", "LTHI", "RTHI", "LFHD", "LTOE", "LFIN"])
    assert [marker.name for marker in few.markers if marker.torso] == ["LASI", "LTHI", "RTHI"]
    enough = suit.worn(["LASI", "RASI", "C7", "LTHI"])
    assert [marker.name for marker in enough.markers if marker.torso] == ["C7", "LASI", "RASI"]
    with pytest.raises(MarkerSetError, match="at least 3 markers with torso"):
        suit.worn(["LASI", "LTOE", "LFIN", "RFIN"])

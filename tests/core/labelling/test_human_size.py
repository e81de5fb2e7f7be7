"""Height of a performer by the distances of markers, whatever the pose."""

import pytest
from perfanim.core.body.motion import Motion
from perfanim.core.body.standard_skeleton import DEFAULT_HEIGHT_M, default_skeleton
from perfanim.core.labelling.human_size import likely_height_m
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers


def recorded(truth, height_m, marker_set):
    """Return the markers of a performer of some height, and of girths to match."""
    body, share = default_skeleton(height_m), height_m / DEFAULT_HEIGHT_M
    motion = Motion("take", truth.fps, body, truth.rotations[:60], share * truth.root_positions_m[:60])
    return simulate_markers(motion, marker_set.with_offsets(share * marker_set.offsets_m), noise_mm=2.0, seed=1)[0]


@pytest.mark.parametrize("name", ["plug-in-gait", "helen-hayes", "cmu-41"])
@pytest.mark.parametrize("height_m", [1.2, 1.5, 1.95])
def test_height_is_found_by_markers_on_the_limbs(truth, name, height_m):
    marker_set = load_marker_set(name)
    assert likely_height_m(recorded(truth, height_m, marker_set), marker_set) == pytest.approx(height_m, rel=0.06)


@pytest.mark.parametrize("height_m", [1.55, 1.9])
def test_height_is_found_by_feet_and_torso_where_the_limbs_have_no_markers(truth, height_m):
    marker_set = load_marker_set("plug-in-gait")
    kept = [marker.name for marker in marker_set.markers if marker.torso or marker.joint[1:] == "foot"]
    take = recorded(truth, height_m, marker_set.subset(kept))
    assert likely_height_m(take, marker_set) == pytest.approx(height_m, rel=0.06)


def test_torso_and_hands_tell_no_height(truth):
    whole = load_marker_set("boxing")
    marker_set = whole.subset([marker.name for marker in whole.markers if not marker.joint.endswith("foot")])
    assert likely_height_m(recorded(truth, 1.5, marker_set), marker_set) == DEFAULT_HEIGHT_M


def test_distances_that_contradict_each_other_tell_no_height(truth):
    """A hand that has the elbow's label, in a take without legs."""
    whole = load_marker_set("plug-in-gait")
    arms = ("LELB", "RELB", "LWRA", "LWRB", "RWRA", "RWRB")
    worn = whole.subset([each.name for each in whole.markers if each.torso or each.name in arms])
    take = recorded(truth, DEFAULT_HEIGHT_M, worn)
    assert likely_height_m(take, worn) == pytest.approx(DEFAULT_HEIGHT_M, rel=0.06)
    wrist = [take.names.index(name) for name in ("RWRA", "RWRB")]
    take.positions_m[:, take.names.index("RELB")] = take.positions_m[:, wrist].mean(axis=1) - [0.0, 0.08, 0.0]
    assert likely_height_m(take, worn) == DEFAULT_HEIGHT_M

"""Set-up of a take: performers, props, cameras; a damaged part is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import PerfanimError, PropError, SubjectError, TakeError
from perfanim.core.formats.take_file.take_reader import read_take_file, summarise
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.markers.prop import load_prop, prop_tables


def test_a_setup_without_a_part_is_refused(setup: TakeSetup) -> None:
    facts = json.loads(setup.to_json())
    assert TakeSetup.from_json(json.dumps(facts | {"weather": "fine"}).encode(), "") == setup
    for part in ("rig", "subject", "settings", "database", "capture"):
        broken = {key: value for key, value in facts.items() if key != part}
        with pytest.raises(TakeError, match="incomplete"):
            TakeSetup.from_json(json.dumps(broken).encode(), "")
    for data in (b"[1]", b"\xff", b"{"):
        with pytest.raises(TakeError):
            TakeSetup.from_json(data, "")
    with pytest.raises(PerfanimError):
        replace(setup, rig={"cam_0": {"size": 3}}).camera_rig()
    with pytest.raises(PerfanimError):
        replace(setup, performers=(facts["subject"] | {"joint": [1]},)).subjects()


def test_props_are_part_of_the_setup(setup: TakeSetup) -> None:
    sword = load_prop("sword")
    facts = json.loads(replace(setup, props=(prop_tables(sword),)).to_json())
    (known,) = TakeSetup.from_json(json.dumps(facts).encode(), "").carried_props()
    assert (known.name, known.names) == (sword.name, sword.names)
    np.testing.assert_array_equal(known.positions_m, sword.positions_m)
    with pytest.raises(PropError, match="must be a list of tables"):
        replace(setup, props=(facts["props"][0] | {"marker": [1]},)).carried_props()
    with pytest.raises(TakeError, match="incomplete"):
        TakeSetup.from_json(json.dumps(facts | {"props": 5}).encode(), "")


def test_a_take_may_have_no_performer(tmp_path: Path, setup: TakeSetup) -> None:
    bare = replace(setup, performers=())
    assert json.loads(bare.to_json())["subject"] == {}
    assert TakeSetup.from_json(bare.to_json(), "") == bare and bare.subjects() == ()
    write_whole_take(tmp_path / "bare.perftake", bare, TakeNotes("Bare"), [], [])
    listed = summarise(tmp_path / "bare.perftake")
    assert (listed.notes.name, listed.performers, listed.marker_set) == ("Bare", (), "")
    with pytest.raises(TakeError, match="has no poses; solve it, which also labels its markers"):
        read_take_file(tmp_path / "bare.perftake").recorded_poses_of()


def test_further_performers_are_part_of_the_setup(setup: TakeSetup) -> None:
    (worn,) = setup.subjects()
    facts = json.loads(replace(setup, performers=2 * setup.performers).to_json())
    assert facts["performers"] == [facts["subject"]]
    _, known = TakeSetup.from_json(json.dumps(facts).encode(), "").subjects()
    assert (known.name, known.marker_set.names) == (worn.name, worn.marker_set.names)
    np.testing.assert_array_equal(known.skeleton.offsets_m, worn.skeleton.offsets_m)
    with pytest.raises(SubjectError, match="must be a list of tables"):
        replace(setup, performers=(*setup.performers, setup.performers[0] | {"joint": [1]})).subjects()

from dataclasses import replace

import numpy as np
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.session_cache import SessionCache
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings


def test_takes_with_a_shared_session_are_solved_independently(truth, subject, database_file, database):
    """Bit by bit, whatever was solved before: or a batch would depend on the order of its takes."""
    takes = [simulate_markers(truth, subject, noise_mm=2.0, dropout=0.05, seed=seed)[0] for seed in (1, 2)]
    takes = [replace(take, positions_m=take.positions_m[:25], frame_numbers=[], times_s=[]) for take in takes]
    store, settings = SessionCache(), SolveSettings()
    alone = [solve_take(take, subject, database, settings, _quiet) for take in takes]
    for take, own in zip((*takes, takes[0]), (*alone, alone[0]), strict=True):
        twin = Subject(subject.name, subject.skeleton, subject.marker_set)
        shared = solve_take(take, twin, store.database(database_file), settings, _quiet, store.session)
        assert np.array_equal(shared.motion.rotations, own.motion.rotations)
        assert np.array_equal(shared.motion.root_positions_m, own.motion.root_positions_m)
        assert [pose.confidence for pose in shared.poses_of()] == [pose.confidence for pose in own.poses_of()]


def test_sessions_are_shared_by_performer_database_and_settings(subject, database_file, stage_rig):
    store, settings = SessionCache(), SolveSettings(method="nearest")
    database = store.database(database_file)
    assert store.database(str(database_file)) is database
    session = store.session(subject, database, None, settings)
    assert store.session(replace(subject), database, None, settings) is session
    boxer = Subject(subject.name, subject.skeleton, load_marker_set("boxing"))
    assert store.session(boxer, database, None, settings) is not session
    assert store.session(subject, database, None, SolveSettings(method="lwr")) is not session
    assert store.session(subject, database, stage_rig, settings) is not store.session(
        subject, database, stage_rig, settings
    )


def _quiet(fraction, text):
    pass

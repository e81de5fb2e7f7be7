"""Hands whose markers nobody sees while they are up in a jump."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.kernel.library import Stage, use_kernel
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.run_demo import embedded_database
from perfanim.core.simulate.shipped_performance import DEMO, performance
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver import best_estimate
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import no_progress

JUMP = 560, 640  # frames of the demo, until the hands are seen again
RAISED_M = 0.35  # of a hand above the hips


@pytest.mark.long
def test_other_markers_do_not_inflate_hidden_hands(tmp_path, monkeypatch, request):
    request.addfinalizer(partial(use_kernel, Stage.is_compiled))
    use_kernel(False)  # the kernel has its own copy of the limit
    database = embedded_database(tmp_path / "embedded.pfdb", no_progress)
    truth = sliced(performance(DEMO), *JUMP)
    subject = Subject("Jumper", truth.skeleton, load_marker_set("boxing"))
    take, _ = simulate_markers(truth, subject)
    hands = [take.names.index(name) for name in ("LHAN", "RHAN")]
    positions = take.positions_m.copy()
    raised = positions[:, hands, 1].min(axis=1) > truth.root_positions_m[:, 1] + RAISED_M
    positions[np.ix_(raised, hands)] = np.nan

    def farthest_m() -> float:
        found = solve_take(
            replace(take, positions_m=positions), subject, database, SolveSettings(), no_progress, causal=True
        ).motion
        off_m = [
            np.linalg.norm(
                forward_kinematics(found.skeleton, found.rotations[frame], found.root_positions_m[frame])[0]
                - forward_kinematics(truth.skeleton, truth.rotations[frame], truth.root_positions_m[frame])[0],
                axis=1,
            )
            for frame in np.flatnonzero(raised)
        ]
        return float(np.array(off_m)[:, [truth.skeleton.index(name) for name in ("lhand", "rhand")]].max())

    with_rule = farthest_m()
    monkeypatch.setattr(best_estimate, "_LEAST_OFF", 0.0)
    assert with_rule < 0.7 * farthest_m()

import json

import pytest
from perfanim.core.errors import SettingsError
from perfanim.core.solver.settings import METHODS, LwrSettings, NearestSettings, SolveSettings


def test_defaults_are_the_papers_values():
    settings = SolveSettings()
    paper = settings.local_pca
    assert (settings.query_alpha, paper.control_alpha, paper.smoothness_beta) == (0.8, 0.8, 0.2)
    for method in METHODS:
        assert SolveSettings(method=method).method == method


@pytest.mark.parametrize(
    "change",
    [
        {"method": "magic"},
        {"query_alpha": 1.1},
        {"control_alpha": -0.1},
        {"smoothness_beta": float("nan")},
        {"marker_sigma_m": 0.0},
        {"best_known_change_share": 0.0},
        {"pose_sigma_rad": float("nan")},
        {"neighbours": ()},
        {"neighbours": (30, 20)},
        {"dimensions": (0, 5)},
        {"best_history_s": ()},
        {"best_history_s": (0.25, 0.1)},
        {"best_history_s": (0.0, 0.1)},
    ],
)
def test_values_out_of_range_are_refused(change):
    with pytest.raises(SettingsError):
        SolveSettings.of_table(change)


def test_stored_settings_round_trip():
    stored = {
        "method": "local-pca",
        "query_alpha": 0.7,
        "search": "graph",
        "best_neighbours": 200,
        "best_history_s": [0.1, 0.2],
        "root_sigma_m": 0.02,
        "control_alpha": 0.5,
        "neighbours": [40, 80],
        "query_pose_m_per_rad": 0.3,
        "lwr_neighbours": 9,
    }
    settings = SolveSettings.of_table(stored)
    assert (settings.best.neighbours, settings.best.history_s, settings.best.root_sigma_m) == (200, (0.1, 0.2), 0.02)
    assert (settings.local_pca.control_alpha, settings.local_pca.neighbours) == (0.5, (40, 80))
    # the methods without candidates for K search for as many examples as the largest of them
    assert settings.lwr == LwrSettings(examples=80, query_pose_m_per_rad=0.3, neighbours=9)
    assert settings.nearest == NearestSettings(examples=80, query_pose_m_per_rad=0.3)
    assert json.loads(json.dumps(settings.table())) == stored
    assert SolveSettings.of_table(settings.table()) == settings
    assert SolveSettings().table() == {}
    with pytest.raises(SettingsError, match="there is no setting 'neighbors'"):
        SolveSettings.of_table({"neighbors": [3]})

import pytest
from perfanim.core.errors import SettingsError
from perfanim.core.solver.settings import METHODS, SolveSettings


def test_the_papers_values_are_the_defaults():
    settings = SolveSettings()
    assert (settings.query_alpha, settings.control_alpha, settings.smoothness_beta) == (0.8, 0.8, 0.2)
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
        SolveSettings(**change)

"""Compared methods, with the settings found on takes that no test uses.

The paper names neither the units of its terms nor its grid of K. Both were chosen by the mean error on the takes
16_31, 07_08, 16_06, 09_06 and the second third of 14_02, with their frames out of the database.
"""

from pathlib import Path

from perfanim.core.solver.motion_prior import open_network
from perfanim.core.solver.settings import BestSettings, LocalPcaSettings, SolveSettings

BASELINE = "best of the other version"

PAPER_RANGE = SolveSettings(
    method="local-pca",
    local_pca=LocalPcaSettings(
        neighbours=(30, 60, 120),
        dimensions=(3, 5, 7),
        marker_sigma_m=0.03,
        pose_sigma_rad=1.0,
        query_pose_m_per_rad=0.3,
    ),
    search="exhaustive",
)
TUNED = SolveSettings(
    method="local-pca",
    local_pca=LocalPcaSettings(
        neighbours=(400,),
        dimensions=(50,),
        marker_sigma_m=0.003,
        pose_sigma_rad=1.0,
        query_pose_m_per_rad=1.0,
    ),
    search="exhaustive",
)

_NO_PRIOR = BestSettings(prior_share=0.0)
WITHOUT_PRIOR = SolveSettings(best=_NO_PRIOR)  # the shipped one has seen every subject

# methods are compared, not searches: every one gets the truly closest frames
METHODS: dict[str, SolveSettings] = {
    "nearest": SolveSettings(method="nearest", search="exhaustive"),
    "lwr": SolveSettings(method="lwr", search="exhaustive"),
    "local-pca (paper's range)": PAPER_RANGE,
    "local-pca (tuned)": TUNED,
    "best": SolveSettings(search="exhaustive", best=_NO_PRIOR),
}


def default_settings(out: Path, subject: str, search: str = "auto") -> SolveSettings:
    """Return the default settings without a prior that has seen the subject.

    The prior is the first of those beside the databases in `out` (`motion_prior*.npz`, see `tools/train_prior.py`) that
    was not trained on the subject, never the shipped one, which has seen everybody; none if there is no such file.
    """
    best = _NO_PRIOR
    for path in sorted((out / "databases").glob("motion_prior*.npz"), reverse=True):
        network = open_network(path)
        if network is not None and subject not in network.facts["subjects"]:
            best = BestSettings(prior_share=1.0, prior_file=str(path))
    return SolveSettings(search=search, best=best)

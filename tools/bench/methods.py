"""Compared methods, with the settings found on takes that no test uses.

The paper names neither the units of its terms nor its grid of K. Both were chosen by the mean error on the takes
16_31, 07_08, 16_06, 09_06 and the second third of 14_02, with their frames out of the database.
"""

from perfanim.core.solver.settings import LocalPcaSettings, SolveSettings

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

# methods are compared, not searches: every one gets the truly closest frames
METHODS: dict[str, SolveSettings] = {
    "nearest": SolveSettings(method="nearest", search="exhaustive"),
    "lwr": SolveSettings(method="lwr", search="exhaustive"),
    "local-pca (paper's range)": PAPER_RANGE,
    "local-pca (tuned)": TUNED,
    "best": SolveSettings(search="exhaustive"),
}

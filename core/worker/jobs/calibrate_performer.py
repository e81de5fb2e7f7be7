"""Job: record a performer's calibration poses and calibrate the subject from them.

The RESULT is that of `record_pose` with additional "subject" (the file), "residual_mm", "verdict" and "advice".
"""

from ...markers.marker_set import load_marker_set
from ...markers.subject import save_subject
from ...subjects.pose_calibration import calibrate_subject, pose_points
from ...subjects.prototype_bodies import load_bodies
from ..channel import Channel
from ..requests import CalibratePerformerRequest
from .record_pose import record_poses


def run(request: CalibratePerformerRequest, channel: Channel) -> None:
    """Record and calibrate; after a STOP no RESULT is sent.

    Raises:
        PerfanimError: The source cannot be opened or used, does not show the performer, or a pose was not held.
    """
    take, result = record_poses(request, channel)
    channel.send_status("measuring the performer")
    marker_set = load_marker_set(request.marker_set)
    points = pose_points(take, marker_set, request.poses)
    found = calibrate_subject(points, marker_set, load_bodies(), request.name, *request.poses)
    save_subject(found.subject, request.subject_out)
    measured = {"residual_mm": 1e3 * found.subject.residual_m, "verdict": found.verdict, "advice": list(found.advice)}
    channel.send_result({**result, **measured, "subject": request.subject_out})

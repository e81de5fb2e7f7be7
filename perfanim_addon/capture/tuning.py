"""Tuned numbers of a capture in Blender."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CaptureTuning:
    """Times, limits and sizes; chosen by trial unless a comment says more."""

    tick_s: float = 1 / 240  # half of it is a pose's mean delay; a tick without a pose takes 0.1 ms
    sidebar_s: float = 1.0  # time between redraws of the statistics, which redraw the viewport, too
    stop_limit_s: float = 8.0  # time for the last frames after Stop, on an idle computer
    freeze_notice_s: float = 0.2  # silence of the cameras until the panel reports it
    rate_window_s: float = 1.0  # time over which the frame rate is counted
    slownesses: tuple[int, ...] = (3, 5, 10, 20, 50)  # reported factors: few, so that the text rarely changes
    judged_poses: int = 600  # poses at the end of a capture that its judgement counts: ten seconds at 60 Hz
    refined_at_s: tuple[float, float] = (20.0, 60.0)  # motion for a first refinement, and for one of a whole minute
    poses_in_memory: int = 1000  # poses that are written to the disk together
    least_step_s: float = 1e-4  # distance of poses with equal times
    beep_s: float = 0.12
    tested_poses: int = 60  # poses of the self-test
    sure: float = 0.5  # confidence of a good pose in the self-test


TUNING = CaptureTuning()

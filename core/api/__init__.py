"""The library's public interface: functions and typed requests shared by commands, Blender's panels and scripts.

`import perfanim` offers the names in `__all__`, which keep their meaning between versions. All other modules,
functions and attributes may change.
"""

from ..body.motion_metrics import evaluate
from ..database.build_database import BuildSettings, build_database
from ..database.store import open_database
from ..errors import PerfanimError
from ..formats.motion.read_motion import read_motion as load_motion
from ..formats.take_file.take_reader import read_take_file as load_recording
from ..session.session import Session
from ..session.solved_take import SolvedTake
from .calibration import calibrate_cameras, calibrate_subject, fit_subject
from .retargeting import RetargetRequest, retarget
from .solving import SolveRequest, solve
from .take_reading import load_subject, load_take

__all__ = [
    "BuildSettings",
    "PerfanimError",
    "RetargetRequest",
    "Session",
    "SolveRequest",
    "SolvedTake",
    "build_database",
    "calibrate_cameras",
    "calibrate_subject",
    "evaluate",
    "fit_subject",
    "load_motion",
    "load_recording",
    "load_subject",
    "load_take",
    "open_database",
    "retarget",
    "solve",
]

"""Manual pages for buttons and settings, opened by F1."""

from pathlib import Path

import bpy

FOLDER = Path(__file__).resolve().parents[2] / "manual"
_CAPTURE, _SKETCH = "capture-in-blender.html", "sketch-in-blender.html"

# Patterns of operators and settings per page; the first match counts.
_OPERATORS = (
    (f"{_CAPTURE}#guide", "show_cameras skip_step unskip_steps propose_exposure"),
    ("people.html", "*body_network"),
    ("hardware.html#check-it", "check_setup ignore_reflections forget_ignored"),
    ("calibration.html#performer", "calibrate_performer calibrate_subject"),
    ("calibration.html#refine-by-a-take", "*refine*_performer"),
    (f"{_CAPTURE}#cameras", "calibrate_* set_floor* save_board"),
    (f"{_CAPTURE}#markers-and-subject", "record_t_pose average_performer use_profile"),
    ("motion-data.html", "get_motion"),
    (f"{_CAPTURE}#motion-database", "build_database use_starter_database"),
    (f"{_CAPTURE}#hands", "pose_hands*"),
    (f"{_CAPTURE}#character", "*_character *bone* use_active_armature show_t_pose"),
    (f"{_CAPTURE}#additional-targets", "*_target"),
    ("batch.html", "*batch*"),
    ("marker-takes.html#in-blender", "import_takes"),
    (_SKETCH, "*sketch* add_controls draw_hips_path follow_* *behaviour show_motion_paths"),
    (f"{_CAPTURE}#clean-up-motion", "*_motion remove_pop hold_feet"),
    (f"{_CAPTURE}#takes-and-batches", "*take*"),
    (f"{_CAPTURE}#preferences", "self_test copy_diagnostics"),
    (f"{_CAPTURE}#capture", "*"),
)
_SETTINGS = (
    (_SKETCH, "*sketch*"),
    ("batch.html", "*batch*"),
    ("vmc.html", "*sending* *receiving*"),
    (f"{_CAPTURE}#additional-targets", "*target*"),
    (f"{_CAPTURE}#takes-and-batches", "*result*"),
    ("people.html", "*.follow"),
    (f"{_CAPTURE}#cameras", "*.board* *.threshold*"),
    ("wear-markers.html", "*.marker*"),
    (f"{_CAPTURE}#markers-and-subject", "*.subject*"),
    (f"{_CAPTURE}#motion-database", "*.database*"),
    (f"{_CAPTURE}#character", "*.armature"),
    (f"{_CAPTURE}#capture", "pg_settings.*"),
    (_CAPTURE, "*"),
)
PAGES = tuple(
    (prefix + pattern, page)
    for prefix, rows in (("bpy.ops.perfanim.", _OPERATORS), ("bpy.types.perfanim_", _SETTINGS))
    for page, patterns in rows
    for pattern in patterns.split()
)


def manual_map() -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the address of the manual and its pages; a source checkout has no pages."""
    return f"{FOLDER.as_uri()}/", PAGES if FOLDER.is_dir() else ()


def register() -> None:
    """Register the pages."""
    bpy.utils.register_manual_map(manual_map)


def unregister() -> None:
    """Undo `register`."""
    bpy.utils.unregister_manual_map(manual_map)

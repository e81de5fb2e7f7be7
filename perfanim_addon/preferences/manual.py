"""Pages of the manual for buttons and settings, opened by F1."""

from pathlib import Path

import bpy

FOLDER = Path(__file__).resolve().parents[2] / "manual"
_CAPTURE = "capture-in-blender.html"

# Blender's name of an operator or setting -> page; the first pattern that fits counts
PAGES = (
    ("bpy.ops.perfanim.show_cameras", f"{_CAPTURE}#guide"),
    ("bpy.ops.perfanim.check_setup", "hardware.html#check-it"),
    ("bpy.ops.perfanim.ignore_reflections", "hardware.html#check-it"),
    ("bpy.ops.perfanim.forget_ignored", "hardware.html#check-it"),
    ("bpy.ops.perfanim.skip_step", f"{_CAPTURE}#guide"),
    ("bpy.ops.perfanim.calibrate_performer", "calibration.html#performer"),
    ("bpy.ops.perfanim.calibrate_subject", "calibration.html#performer"),
    ("bpy.ops.perfanim.*refine*_performer", "calibration.html#refine-by-a-take"),
    ("bpy.ops.perfanim.calibrate_*", f"{_CAPTURE}#cameras"),
    ("bpy.ops.perfanim.set_floor*", f"{_CAPTURE}#cameras"),
    ("bpy.ops.perfanim.save_board", f"{_CAPTURE}#cameras"),
    ("bpy.ops.perfanim.record", f"{_CAPTURE}#capture"),
    ("bpy.ops.perfanim.record_t_pose", f"{_CAPTURE}#markers-and-subject"),
    ("bpy.ops.perfanim.average_performer", f"{_CAPTURE}#markers-and-subject"),
    ("bpy.ops.perfanim.use_profile", f"{_CAPTURE}#markers-and-subject"),
    ("bpy.ops.perfanim.get_motion", "motion-data.html"),
    ("bpy.ops.perfanim.build_database", f"{_CAPTURE}#motion-database"),
    ("bpy.ops.perfanim.use_starter_database", f"{_CAPTURE}#motion-database"),
    ("bpy.ops.perfanim.*_character", f"{_CAPTURE}#character"),
    ("bpy.ops.perfanim.*bone*", f"{_CAPTURE}#character"),
    ("bpy.ops.perfanim.use_active_armature", f"{_CAPTURE}#character"),
    ("bpy.ops.perfanim.show_t_pose", f"{_CAPTURE}#character"),
    ("bpy.ops.perfanim.*_target", f"{_CAPTURE}#additional-targets"),
    ("bpy.ops.perfanim.run_batch", "batch.html"),
    ("bpy.ops.perfanim.*batch*", "batch.html"),
    ("bpy.ops.perfanim.import_takes", "marker-takes.html"),
    ("bpy.ops.perfanim.*take*", f"{_CAPTURE}#takes-and-batches"),
    ("bpy.ops.perfanim.*sketch*", "sketch-in-blender.html"),
    ("bpy.ops.perfanim.add_controls", "sketch-in-blender.html"),
    ("bpy.ops.perfanim.draw_hips_path", "sketch-in-blender.html"),
    ("bpy.ops.perfanim.follow_*", "sketch-in-blender.html"),
    ("bpy.ops.perfanim.*behaviour", "sketch-in-blender.html"),
    ("bpy.ops.perfanim.show_motion_paths", "sketch-in-blender.html"),
    ("bpy.ops.perfanim.self_test", f"{_CAPTURE}#preferences"),
    ("bpy.ops.perfanim.copy_diagnostics", f"{_CAPTURE}#preferences"),
    ("bpy.ops.perfanim.*", f"{_CAPTURE}#capture"),
    ("bpy.types.perfanim_*sketch*", "sketch-in-blender.html"),
    ("bpy.types.perfanim_*batch*", "batch.html"),
    ("bpy.types.perfanim_*sending*", "vmc.html"),
    ("bpy.types.perfanim_*receiving*", "vmc.html"),
    ("bpy.types.perfanim_*target*", f"{_CAPTURE}#additional-targets"),
    ("bpy.types.perfanim_*result*", f"{_CAPTURE}#takes-and-batches"),
    ("bpy.types.perfanim_*.board*", f"{_CAPTURE}#cameras"),
    ("bpy.types.perfanim_*.marker*", "wear-markers.html"),
    ("bpy.types.perfanim_*.threshold*", f"{_CAPTURE}#cameras"),
    ("bpy.types.perfanim_*.subject*", f"{_CAPTURE}#markers-and-subject"),
    ("bpy.types.perfanim_*.database*", f"{_CAPTURE}#motion-database"),
    ("bpy.types.perfanim_*.armature", f"{_CAPTURE}#character"),
    ("bpy.types.perfanim_pg_settings.*", f"{_CAPTURE}#capture"),
    ("bpy.types.perfanim_*", _CAPTURE),
)


def manual_map() -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the address of the manual and its pages; a working tree has none."""
    return f"{FOLDER.as_uri()}/", PAGES if FOLDER.is_dir() else ()


def register() -> None:
    """Register the pages."""
    bpy.utils.register_manual_map(manual_map)


def unregister() -> None:
    """Undo `register`."""
    bpy.utils.unregister_manual_map(manual_map)

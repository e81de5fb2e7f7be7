"""Settings of the capture panels, stored in the scene."""

from typing import Any

import bpy

from ...core.markers.marker_set import marker_set_names
from ..character.posing import fill_map
from ..jobs import activity
from ..preferences.attach_settings import attach_property_group

SOURCES = (
    ("SIMULATED", "Simulated Performer", "Simulate a performer and two cameras: needs no hardware"),
    ("CAMERAS", "Cameras", "Two cameras connected to this computer, by device number"),
    ("VIDEOS", "Videos", "A recorded video of each camera"),
    ("IMAGES", "Image Folders", "A folder of numbered images of each camera"),
    ("VMC", "Trackers (VMC)", "Trackers or markers sent by another program over the Virtual Motion Capture protocol"),
)

FEET = (
    ("off", "Free", "Do not lock the feet"),
    ("auto", "Auto", "Lock a standing foot until it lifts or moves off"),
    ("always", "Always", "Always lock the lower foot, even while sliding. Not for jumps"),
)

BODY_PARTS = (
    ("HIPS", "Hips", "Hips, and the motion through the scene", 1),
    ("TORSO", "Torso", "Back and chest", 2),
    ("HEAD", "Head", "Neck and head", 4),
    ("ARM_L", "Arm L", "Left shoulder, arm and hand", 8),
    ("ARM_R", "Arm R", "Right shoulder, arm and hand", 16),
    ("LEG_L", "Leg L", "Left leg and foot", 32),
    ("LEG_R", "Leg R", "Right leg and foot", 64),
)

OVERLAYS = (
    (
        "MARKERS",
        "Markers",
        "Dots for visible markers, rings for hidden ones, lines to the camera for those seen by one camera",
        1,
    ),
    ("SKELETON", "Skeleton", "The solved skeleton over the character: green for high confidence, red for low", 2),
)

BEHAVIOURS = (
    ("demo", "Everything", "All behaviours in turn"),
    ("walking", "Walking", "Walking back and forth"),
    ("running", "Running", "Running back and forth"),
    ("hopping", "Hopping", "Hopping on either leg"),
    ("jumping", "Jumping", "Jumping on the spot and forward"),
    ("boxing", "Boxing", "Shadow boxing"),
    ("kendo", "Kendo", "Sword strokes"),
)

BOARD_CODES = tuple(f"DICT_{size}X{size}_{count}" for size in (4, 5, 6, 7) for count in (50, 100, 250, 1000))

_marker_sets: list[tuple[str, str, str]] = []  # Blender keeps no reference to a dynamic enumeration's strings


def _marker_set_items(_self: object, _context: object) -> list[tuple[str, str, str]]:
    if not _marker_sets:
        names = sorted(marker_set_names(), key=lambda name: (name != "boxing", name))
        _marker_sets.extend((name, name.replace("-", " ").title(), f"The marker set {name!r}") for name in names)
    return _marker_sets


def find_bones(self: Any, _context: object) -> None:
    """Map the bones of a newly chosen armature to joints."""
    if self.armature is not None:
        fill_map(self.armature)


def _retune(self: Any, _context: object) -> None:
    """Apply the new filter settings to a running capture."""
    tune = getattr(activity.current(), "tune", None)
    if tune is not None:
        tune(self)


def is_armature(_self: object, candidate: bpy.types.Object) -> bool:
    """Accept armatures only."""
    return candidate.type == "ARMATURE"


def _file(name: str, description: str) -> Any:
    return bpy.props.StringProperty(name=name, description=description, subtype="FILE_PATH")


def _folder(name: str, description: str) -> Any:
    return bpy.props.StringProperty(name=name, description=description, subtype="DIR_PATH")


class CameraSettings:
    """Settings of the Cameras panel: source of the images."""

    source: bpy.props.EnumProperty(
        name="Source", description="Source of the images or trackers", items=SOURCES, default="SIMULATED"
    )
    behaviour: bpy.props.EnumProperty(
        name="Behaviour", description="Motion of the simulated performer", items=BEHAVIOURS, default="demo"
    )
    practise: bpy.props.BoolProperty(
        name="Practise Calibration",
        description="Treat the simulated cameras and performer as real: calibrate them before the capture",
        default=False,
    )
    left_device: bpy.props.IntProperty(
        name="Left", description="Device number of the left camera, from the cameras' point of view", default=0, min=0
    )
    right_device: bpy.props.IntProperty(
        name="Right",
        description="Device number of the right camera, from the cameras' point of view; -1 for one camera only",
        default=1,
        min=-1,
    )
    further_devices: bpy.props.StringProperty(
        name="Additional",
        description="Device numbers of more cameras, such as 2, 3. Calibrate with Board needs the board in view of all",
    )
    width: bpy.props.IntProperty(
        name="Width", description="Image width", default=640, min=160, max=4096, subtype="PIXEL"
    )
    height: bpy.props.IntProperty(
        name="Height", description="Image height", default=480, min=120, max=4096, subtype="PIXEL"
    )
    camera_fps: bpy.props.FloatProperty(
        name="Rate (Hz)", description="Frame rate requested from the cameras", default=60, min=1, max=500
    )
    left_video: _file("Left", "Video of the left camera")
    right_video: _file("Right", "Video of the right camera; empty for one camera only")
    left_folder: _folder("Left", "Folder with the left camera's numbered images")
    right_folder: _folder("Right", "Folder with the right camera's numbered images; empty for one camera only")
    files_fps: bpy.props.FloatProperty(
        name="Rate (Hz)", description="Frame rate at which the images were taken", default=60, min=1, max=500
    )
    calibration: _file("Calibration", "Calibration file of the two cameras (TOML)")


class CalibrationSettings:
    """Settings of the Cameras panel: board and floor."""

    board_kind: bpy.props.EnumProperty(
        name="Board",
        description="Pattern printed on the board",
        items=(
            ("CHESSBOARD", "Chessboard", "Plain squares; must be fully visible"),
            ("CHARUCO", "ChArUco", "Squares with markers; may be partly hidden"),
        ),
    )
    board_columns: bpy.props.IntProperty(
        name="Columns",
        description="Inner corners of a chessboard per row, or squares of a ChArUco board",
        default=9,
        min=3,
        max=50,
    )
    board_rows: bpy.props.IntProperty(
        name="Rows",
        description="Inner corners of a chessboard per column, or squares of a ChArUco board",
        default=6,
        min=3,
        max=50,
    )
    board_square_mm: bpy.props.FloatProperty(
        name="Square (mm)",
        description="Side of a square, measured on the print",
        default=24,
        min=1,
        max=1000,
    )
    board_code_mm: bpy.props.FloatProperty(
        name="Marker (mm)",
        description="Side of a printed marker, measured on the print; smaller than its square",
        default=18,
        min=1,
        max=1000,
    )
    board_dictionary: bpy.props.EnumProperty(
        name="Dictionary",
        description="Dictionary of the printed markers",
        items=tuple(
            (name, name.removeprefix("DICT_"), "Marker grid size and number of markers in the dictionary")
            for name in BOARD_CODES
        ),
    )
    board_views: bpy.props.IntProperty(
        name="Max Views",
        description="Stop after this many views of the board even if the result is not good",
        default=40,
        min=3,
        max=200,
    )
    board_timed: bpy.props.BoolProperty(
        name="Timed",
        description="Take views after a countdown instead of when the board is held still",
        default=False,
    )
    board_every_s: bpy.props.FloatProperty(
        name="Every",
        description="Time to move the board between two views",
        default=3,
        min=0.5,
        max=60,
        subtype="TIME_ABSOLUTE",
    )
    floor_height_mm: bpy.props.FloatProperty(
        name="Height (mm)",
        description="Height of a marker's centre above the floor: the radius of a ball",
        default=12.5,
        min=0,
        max=200,
    )
    floor_longest_mm: bpy.props.FloatProperty(
        name="Span (mm)",
        description="Distance between the centres of the two markers farthest apart; scales the calibration. "
        "0 keeps the calibration's scale",
        default=0,
        min=0,
        max=20000,
    )
    board_left: _folder("Left", "Folder with the left camera's images of the board")
    board_right: _folder("Right", "Folder with the right camera's images of the board")


class MarkerSettings:
    """Settings of the Markers panel."""

    marker_set: bpy.props.EnumProperty(name="Set", description="Markers on the performer", items=_marker_set_items)
    marker_set_file: _file("File", "Custom marker set (TOML); empty for the set above")
    threshold_auto: bpy.props.BoolProperty(
        name="Auto", description="Choose the brightness threshold from the learned background", default=True
    )
    threshold: bpy.props.FloatProperty(
        name="Threshold",
        description="Grey levels by which the pixels of a marker differ from the learned background",
        default=38,
        min=1,
        max=255,
    )
    background_s: bpy.props.FloatProperty(
        name="Background",
        description="Time at the start of a capture for learning the empty view: stay out of sight",
        default=2,
        min=0.1,
        max=60,
        subtype="TIME_ABSOLUTE",
    )


class SubjectSettings:
    """Settings of the Subject panel."""

    subject: _file("Subject", "Calibrated performer (TOML); empty for the simulated performer")
    subject_name: bpy.props.StringProperty(
        name="Name", description="Name of the performer to calibrate", default="Performer"
    )
    countdown_s: bpy.props.FloatProperty(
        name="Countdown",
        description="Time to walk in front of the cameras and take the T pose, after the background is learned",
        default=8,
        min=0,
        max=60,
        subtype="TIME_ABSOLUTE",
    )
    between_s: bpy.props.FloatProperty(
        name="Next Pose",
        description="Time from one calibration pose to the next",
        default=5,
        min=1,
        max=60,
        subtype="TIME_ABSOLUTE",
    )
    subject_height: bpy.props.FloatProperty(
        name="Height (m)", description="Height of the performer", default=1.75, min=1.2, max=2.3
    )
    subject_take: _file("Take", "Marker take of the calibration poses, T pose first")
    take_poses: bpy.props.BoolProperty(
        name="All Three Poses",
        description="The take has T pose, hanging arms and motorcycle pose; otherwise the T pose only",
        default=False,
    )


class DatabaseSettings:
    """Settings of the Motion Database panel."""

    database: _file("Database", "Motion database (.pfdb); empty for the starter database")
    database_fps: bpy.props.FloatProperty(
        name="Rate (Hz)", description="Frames per second of imported motion in the database", default=60, min=5, max=240
    )


class CaptureSettings:
    """Settings of the Character and Capture panels."""

    armature: bpy.props.PointerProperty(
        name="Armature",
        description="Armature to animate; empty adds a new character at the start",
        type=bpy.types.Object,
        poll=is_armature,
        update=find_bones,
    )
    capture_preview: bpy.props.BoolProperty(
        name="Preview",
        description="Show the camera images while capturing. Markers are green if seen by both cameras, orange by one; "
        "other blobs are red",
        default=False,
    )
    overlay: bpy.props.EnumProperty(
        name="Overlay",
        description="Drawn over the 3D viewports while live, with the solver's confidence. Shift-click for both",
        items=OVERLAYS,
        default=set(),
        options={"ENUM_FLAG"},
    )
    record_by_button: bpy.props.BoolProperty(
        name="Record by Button",
        description="Rehearse until Record is clicked; each recording becomes a separate action",
        default=False,
    )
    record_countdown_s: bpy.props.IntProperty(
        name="Countdown",
        description="Seconds from the first pose to the recording; the character already moves. 0 starts at once",
        default=0,
        min=0,
        max=60,
        subtype="TIME_ABSOLUTE",
    )
    record_sound: bpy.props.BoolProperty(
        name="Sound", description="Beep every second of the countdown, and higher at its end", default=True
    )
    record_length_s: bpy.props.FloatProperty(
        name="Stop After",
        description="Length of the recording, after which the capture stops. 0 for no limit",
        default=0,
        min=0,
        soft_max=600,
        subtype="TIME_ABSOLUTE",
    )
    smoothing_ms: bpy.props.FloatProperty(
        name="Smoothing (ms)",
        description="Removes jitter. Adds up to this much delay; less during fast motion. 0 turns it off. The take "
        "keeps the unfiltered motion",
        default=0,
        min=0,
        max=200,
        precision=0,
        step=100,
        update=_retune,
    )
    feet: bpy.props.EnumProperty(
        name="Feet",
        description="Foot lock: keeps standing feet in place. The take keeps the unfiltered motion",
        items=FEET,
        default="off",
        update=_retune,
    )
    body_parts: bpy.props.EnumProperty(
        name="Body Parts",
        description="Parts of the body to animate, Shift-click for several; the others keep their own animation",
        items=BODY_PARTS,
        default={key for key, *_ in BODY_PARTS},
        options={"ENUM_FLAG"},
    )
    extend_scene: bpy.props.BoolProperty(
        name="Extend Scene",
        description="Extend the scene if the recording is longer",
        default=True,
    )


class PERFANIM_PG_settings(
    CameraSettings,
    CalibrationSettings,
    MarkerSettings,
    SubjectSettings,
    DatabaseSettings,
    CaptureSettings,
    bpy.types.PropertyGroup,
):
    """Settings in the order of the panels; one group, as saved files have it."""


def settings(context: bpy.types.Context) -> PERFANIM_PG_settings:
    """Return the scene's settings."""
    return context.scene.perfanim


register, unregister = attach_property_group(bpy.types.Scene, "perfanim", PERFANIM_PG_settings)

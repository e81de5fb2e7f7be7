"""Settings of a capture, kept in the scene; the defaults need nothing but a click on Start Capture."""

from typing import Any

import bpy

from ...core.markers.marker_set import marker_set_names
from ..character.posing import fill_map
from ..jobs import activity
from ..preferences.attach_settings import hung_on

SOURCES = (
    ("SIMULATED", "Simulated Performer", "A performer, room and two cameras drawn by the computer: needs no hardware"),
    ("CAMERAS", "Cameras", "Two cameras connected to this computer, by device number"),
    ("VIDEOS", "Videos", "A recorded video of each camera"),
    ("IMAGES", "Image Folders", "A folder of numbered images of each camera"),
    ("VMC", "Trackers (VMC)", "Trackers or markers that another program sends by the Virtual Motion Capture protocol"),
)

FEET = (
    ("off", "Free", "Feet move as they are solved"),
    ("auto", "Auto", "A foot that stands is held in place until it is lifted or moves off"),
    ("always", "Always", "The lower foot is held even if it glides: for who never jumps"),
)

BODY_PARTS = (
    ("HIPS", "Hips", "Hips, and the way through the room", 1),
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
        "A dot where a marker is; a ring where one is lost, at its place on the body; a line to the camera that alone "
        "sees it",
        1,
    ),
    ("SKELETON", "Skeleton", "The body as it is solved, over the character: green where it is sure, red if guessed", 2),
)

BEHAVIOURS = (
    ("demo", "Everything", "All behaviours, one after the other"),
    ("walking", "Walking", "Walking to and fro"),
    ("running", "Running", "Running to and fro"),
    ("hopping", "Hopping", "Hopping on one leg and on the other"),
    ("jumping", "Jumping", "Jumping on the spot and forward"),
    ("boxing", "Boxing", "Boxing against a shadow"),
    ("kendo", "Kendo", "Strokes with a sword"),
)

BOARD_CODES = tuple(f"DICT_{size}X{size}_{count}" for size in (4, 5, 6, 7) for count in (50, 100, 250, 1000))

_marker_sets: list[tuple[str, str, str]] = []  # Blender keeps no reference to a dynamic enumeration's strings


def _marker_set_items(_self: object, _context: object) -> list[tuple[str, str, str]]:
    if not _marker_sets:
        names = sorted(marker_set_names(), key=lambda name: (name != "boxing", name))
        _marker_sets.extend((name, name.replace("-", " ").title(), f"The marker set {name!r}") for name in names)
    return _marker_sets


def find_bones(self: Any, _context: object) -> None:
    """Find which bone is which joint of an armature that has been chosen."""
    if self.armature is not None:
        fill_map(self.armature)


def _retune(self: Any, _context: object) -> None:
    """Let a running capture show its poses by the new setting."""
    tune = getattr(activity.current(), "tune", None)
    if tune is not None:
        tune(self)


def is_armature(_self: object, candidate: bpy.types.Object) -> bool:
    """Let only armatures be chosen."""
    return candidate.type == "ARMATURE"


def _file(name: str, description: str) -> Any:
    return bpy.props.StringProperty(name=name, description=description, subtype="FILE_PATH")


def _folder(name: str, description: str) -> Any:
    return bpy.props.StringProperty(name=name, description=description, subtype="DIR_PATH")


class PERFANIM_PG_settings(bpy.types.PropertyGroup):
    """Settings in the order of the panels."""

    source: bpy.props.EnumProperty(
        name="Source", description="Where images of the performer come from", items=SOURCES, default="SIMULATED"
    )
    behaviour: bpy.props.EnumProperty(
        name="Performs", description="What the simulated performer does", items=BEHAVIOURS, default="demo"
    )
    practise: bpy.props.BoolProperty(
        name="Practise Calibration",
        description="Treat the simulated cameras and performer like real ones: calibrate them before the capture",
        default=False,
    )
    left_device: bpy.props.IntProperty(
        name="Left", description="Device number of the camera on the left as seen by the cameras", default=0, min=0
    )
    right_device: bpy.props.IntProperty(
        name="Right",
        description="Device number of the camera on the right as seen by the cameras; -1: one camera alone",
        default=1,
        min=-1,
    )
    further_devices: bpy.props.StringProperty(
        name="Further",
        description="Device numbers of more cameras, e.g. 2, 3; Calibrate with Board takes the views in which all of "
        "them see the board",
    )
    width: bpy.props.IntProperty(
        name="Width", description="Image width", default=640, min=160, max=4096, subtype="PIXEL"
    )
    height: bpy.props.IntProperty(
        name="Height", description="Image height", default=480, min=120, max=4096, subtype="PIXEL"
    )
    camera_fps: bpy.props.FloatProperty(
        name="Rate (Hz)", description="Images per second that the cameras are asked for", default=60, min=1, max=500
    )
    left_video: _file("Left", "Video of the left camera")
    right_video: _file("Right", "Video of the right camera; empty: one camera alone")
    left_folder: _folder("Left", "Folder with the left camera's numbered images")
    right_folder: _folder("Right", "Folder with the right camera's numbered images; empty: one camera alone")
    files_fps: bpy.props.FloatProperty(
        name="Rate (Hz)", description="Images per second at which the images were taken", default=60, min=1, max=500
    )
    calibration: _file("Calibration", "Calibration file of the two cameras (TOML)")
    board_kind: bpy.props.EnumProperty(
        name="Board",
        description="What is printed on the board",
        items=(
            ("CHESSBOARD", "Chessboard", "Squares alone; counts when it is seen whole"),
            ("CHARUCO", "ChArUco", "Squares with codes in them; counts when it is seen in part, too"),
        ),
    )
    board_columns: bpy.props.IntProperty(
        name="Columns",
        description="In a row: inner corners of a chessboard, squares of a ChArUco board",
        default=9,
        min=3,
        max=50,
    )
    board_rows: bpy.props.IntProperty(
        name="Rows",
        description="In a column: inner corners of a chessboard, squares of a ChArUco board",
        default=6,
        min=3,
        max=50,
    )
    board_square_mm: bpy.props.FloatProperty(
        name="Square (mm)",
        description="Side of a square in millimetres, measured on the print",
        default=24,
        min=1,
        max=1000,
    )
    board_code_mm: bpy.props.FloatProperty(
        name="Code (mm)",
        description="Side of a code in millimetres, measured on the print; smaller than its square",
        default=18,
        min=1,
        max=1000,
    )
    board_dictionary: bpy.props.EnumProperty(
        name="Codes",
        description="Which codes are in the squares",
        items=tuple(
            (name, name.removeprefix("DICT_"), "Codes of so many fields, and how many") for name in BOARD_CODES
        ),
    )
    board_views: bpy.props.IntProperty(
        name="Views at Most",
        description="It ends after so many views of the board even if the result is not good",
        default=40,
        min=3,
        max=200,
    )
    board_timed: bpy.props.BoolProperty(
        name="Timed",
        description="Take a view after a countdown instead of when the board is held still",
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
        description="Millimetres from the floor to the middle of a marker lying on it: the radius of a ball",
        default=12.5,
        min=0,
        max=200,
    )
    floor_longest_mm: bpy.props.FloatProperty(
        name="Farthest (mm)",
        description="Millimetres between the two markers that lie farthest apart, from middle to middle; the "
        "calibration is scaled to it. 0: the calibration's scale is kept",
        default=0,
        min=0,
        max=20000,
    )
    board_left: _folder("Left", "Folder with the left camera's images of the board")
    board_right: _folder("Right", "Folder with the right camera's images of the board")

    marker_set: bpy.props.EnumProperty(name="Set", description="Which markers are worn", items=_marker_set_items)
    marker_set_file: _file("File", "A marker set of your own (TOML); empty: the set chosen above")
    threshold_auto: bpy.props.BoolProperty(
        name="Auto", description="Find the brightness threshold from the learned background", default=True
    )
    threshold: bpy.props.FloatProperty(
        name="Threshold",
        description="How much a pixel must differ from the learned background, in grey levels, to belong to a marker",
        default=38,
        min=1,
        max=255,
    )
    background_s: bpy.props.FloatProperty(
        name="Background",
        description="Seconds at the start of a capture in which the empty room is learned: stay out of sight",
        default=2,
        min=0.1,
        max=60,
        subtype="TIME_ABSOLUTE",
    )

    subject: _file("Subject", "Calibrated performer (TOML); empty: the simulated performer, who is known")
    subject_name: bpy.props.StringProperty(
        name="Name", description="Name for the performer to be calibrated", default="Performer"
    )
    countdown_s: bpy.props.FloatProperty(
        name="Countdown",
        description="Time to walk before the cameras and take the T pose, after the empty room is learned",
        default=8,
        min=0,
        max=60,
        subtype="TIME_ABSOLUTE",
    )
    between_s: bpy.props.FloatProperty(
        name="Next Pose",
        description="Time from each calibration pose to the next",
        default=5,
        min=1,
        max=60,
        subtype="TIME_ABSOLUTE",
    )
    subject_height: bpy.props.FloatProperty(
        name="Height (m)", description="Height of the performer, in metres", default=1.75, min=1.2, max=2.3
    )
    subject_take: _file("Take", "Marker take in which the performer holds calibration poses, the T pose first")
    take_poses: bpy.props.BoolProperty(
        name="All Three Poses",
        description="The take shows the T pose, hanging arms and the motorcycle pose; otherwise the T pose alone",
        default=False,
    )

    database: _file("Database", "Motion database; empty: the starter motion of the add-on")
    database_fps: bpy.props.FloatProperty(
        name="Rate (Hz)", description="Poses per second that an imported database keeps", default=60, min=5, max=240
    )

    armature: bpy.props.PointerProperty(
        name="Armature",
        description="Armature that moves along; empty: a new character is added at the start",
        type=bpy.types.Object,
        poll=is_armature,
        update=find_bones,
    )
    capture_preview: bpy.props.BoolProperty(
        name="Preview",
        description="Show what the cameras see while capturing, and which blobs are taken for markers: "
        "green by both cameras, orange by one alone, red by none",
        default=False,
    )
    overlay: bpy.props.EnumProperty(
        name="Draw",
        description="What is drawn over the 3D views while live, and how sure the solver is; both with Shift",
        items=OVERLAYS,
        default=set(),
        options={"ENUM_FLAG"},
    )
    record_by_button: bpy.props.BoolProperty(
        name="Record by Button",
        description="A capture is a rehearsal until Record is clicked; each recording becomes an Action of its own",
        default=False,
    )
    record_countdown_s: bpy.props.IntProperty(
        name="Countdown",
        description="Seconds from the first pose to the recording; the character moves along meanwhile. 0: at once",
        default=0,
        min=0,
        max=60,
        subtype="TIME_ABSOLUTE",
    )
    record_sound: bpy.props.BoolProperty(
        name="Sound", description="A beep for each second of the countdown, a higher one at its end", default=True
    )
    record_length_s: bpy.props.FloatProperty(
        name="Stop After",
        description="Length of the recording in seconds, after which the capture ends by itself. 0: when you stop it",
        default=0,
        min=0,
        soft_max=600,
        subtype="TIME_ABSOLUTE",
    )
    smoothing_ms: bpy.props.FloatProperty(
        name="Smoothing (ms)",
        description="Calms what trembles; a still body then comes so many milliseconds late, a fast one less. 0: off. "
        "The take keeps the motion as it was solved",
        default=0,
        min=0,
        max=200,
        precision=0,
        step=100,
        update=_retune,
    )
    feet: bpy.props.EnumProperty(
        name="Feet",
        description="Whether feet that stand are held in place. The take keeps the motion as it was solved",
        items=FEET,
        default="off",
        update=_retune,
    )
    body_parts: bpy.props.EnumProperty(
        name="Only",
        description="Parts of the body that the capture moves, several with Shift; the others keep their own animation",
        items=BODY_PARTS,
        default={key for key, *_ in BODY_PARTS},
        options={"ENUM_FLAG"},
    )
    extend_scene: bpy.props.BoolProperty(
        name="Extend Scene",
        description="Move the scene's end frame back if the recording is longer",
        default=True,
    )


def settings(context: bpy.types.Context) -> PERFANIM_PG_settings:
    """Return the scene's settings."""
    return context.scene.perfanim


register, unregister = hung_on(bpy.types.Scene, "perfanim", PERFANIM_PG_settings)

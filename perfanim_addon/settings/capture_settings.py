"""Settings of the capture panels, stored in the scene."""

from functools import cache
from typing import Any

import bpy

from ...core.markers.marker_set import marker_set_names
from ...core.session.gestures import Gesture
from ...core.subjects.setup_check.finding import Fault
from ..character.retarget_plans import fill_map
from ..jobs import activity
from ..preferences.property_kinds import (
    choice,
    duration,
    dynamic_choice,
    file_path,
    folder_path,
    number,
    pointer,
    string,
    switch,
    whole_number,
)
from .camera_choice import NETWORK, NONE, camera_choice

SOURCES = (
    ("SIMULATED", "Simulated Performer", "Simulate a performer and two cameras: needs no hardware"),
    ("CAMERAS", "Cameras", "Two cameras connected to this computer"),
    ("VIDEOS", "Videos", "A recorded video of each camera"),
    ("IMAGES", "Image Folders", "A folder of numbered images of each camera"),
    ("VMC", "Trackers (VMC)", "Trackers or markers sent by another program over the Virtual Motion Capture protocol"),
)

FOLLOWED = (
    ("MARKERS", "Markers", "Reflective markers on the performer: the most accurate"),
    ("PERSON", "Person", "A person in everyday clothes, without markers, found by a neural network"),
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

_SIGNALS = (
    ("NONE", "Button or Key", "Buttons, or Ctrl Shift R"),
    (Gesture.RAISED_HAND.name, "Raised Hand", "Also one hand raised above the head for a second, the other hanging"),
    (Gesture.CLAPS.name, "Two Claps", "Also two claps within a second"),
)
OVERLAYS = (
    (
        "MARKERS",
        "Markers",
        "Dots for visible markers, rings for hidden ones, lines to the camera for those seen by one camera",
        1,
    ),
    ("SKELETON", "Skeleton", "The solved skeleton over the character: green for high confidence, red for low", 2),
    ("SPACE", "Space", "The part of the floor where all cameras see a performer from head to foot, and its size", 4),
    (
        "GHOST",
        "Last Take",
        "The last take's skeleton, in time with the recording; until then in its first pose",
        8,
    ),
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

PRACTISE_FAULTS = (
    ("NONE", "None", "No fault"),
    *(
        (fault.name, fault.capitalize(), f"Practise with a simulated studio that has this fault: {fault}")
        for fault in Fault
        if fault not in (Fault.BOARD_SMALL, Fault.FLIPPED)  # these two need pictures without a performer, or videos
    ),
)

_ADDRESS = (
    "Address of the camera's video stream, as its manual or app shows it, such as rtsp://192.168.1.20:554/stream or "
    "http://192.168.1.20:8080/video. With a user name: rtsp://name:password@... (saved unencrypted in this file)"
)

BOARD_CODES = tuple(f"DICT_{size}X{size}_{count}" for size in (4, 5, 6, 7) for count in (50, 100, 250, 1000))


@cache
def _marker_set_items() -> list[tuple[str, str, str]]:
    names = sorted(marker_set_names(), key=lambda name: (name != "boxing", name))
    return [(name, name.replace("-", " ").title(), f"The marker set {name!r}") for name in names]


def _find_bones(self: Any, _context: object) -> None:
    """Map the bones of a newly chosen armature to joints."""
    if self.armature is not None and self.armature.type != "ARMATURE":  # a script may choose any object
        self.armature = None
    elif self.armature is not None:
        fill_map(self.armature)


def _no_camera_is_right_only(self: Any, _context: object) -> None:
    """Reset the left camera from none, because only the right one is optional."""
    if self.left_device == NONE:
        self.left_device = 0


def _retune(self: Any, _context: object) -> None:
    """Apply the new filter settings to a running capture."""
    tune = getattr(activity.current(), "tune", None)
    if tune is not None:
        tune(self)


def armature_pointer(description: str) -> Any:
    """Return a choice of armature; the chosen one gets a bone map."""
    return pointer(
        "Armature",
        description,
        bpy.types.Object,
        poll=lambda _self, candidate: candidate.type == "ARMATURE",
        update=_find_bones,
    )


class PERFANIM_PG_settings(bpy.types.PropertyGroup):
    """Settings in the order of the panels; one group, as in saved files."""

    attached_to = (bpy.types.Scene, "perfanim")

    # Cameras panel: source of the images
    source: choice("Source", "Source of the images or trackers", SOURCES, "SIMULATED")
    behaviour: choice("Behaviour", "Motion of the simulated performer", BEHAVIOURS, "demo")
    follow: choice("Follow", "What is found in the pictures of the cameras", FOLLOWED, "MARKERS")
    practise: switch(
        "Practise Calibration", "Treat the simulated cameras and performer as real: calibrate them before the capture"
    )
    practise_fault: choice("Fault", "Fault of the simulated studio for Check Setup to find", PRACTISE_FAULTS, "NONE")
    left_device: whole_number(
        "Left",
        "Device number of the left camera, from the cameras' point of view; -2 for a network address",
        0,
        NETWORK,
        update=_no_camera_is_right_only,
    )
    right_device: whole_number(
        "Right",
        "Device number of the right camera, from the cameras' point of view; -1 for one camera only, -2 for a "
        "network address",
        1,
        NETWORK,
    )
    left_address: string("Address", _ADDRESS)
    right_address: string("Address", _ADDRESS)
    left_camera: camera_choice("Left", "The left camera, from the cameras' point of view", "left_device")
    right_camera: camera_choice(
        "Right", "The right camera, from the cameras' point of view, or none", "right_device", optional=True
    )
    further_devices: string(
        "Additional",
        "Device numbers or network addresses of more cameras, such as 2, 3. Calibrate with Board needs the board in "
        "view of all",
    )
    width: whole_number("Width", "Image width", 640, 160, 4096, subtype="PIXEL")
    height: whole_number("Height", "Image height", 480, 120, 4096, subtype="PIXEL")
    camera_fps: number(
        "Rate (Hz)",
        "Frame rate requested from the cameras. 0 leaves it to them: most webcams give 30; set it for faster cameras",
        0,
        0,
        500,
    )
    left_video: file_path("Left", "Video of the left camera")
    right_video: file_path("Right", "Video of the right camera; empty for one camera only")
    left_folder: folder_path(
        "Left",
        "Folder with the left camera's numbered images; or a pattern such as images/*_1.jpg if one folder holds all "
        "images",
    )
    right_folder: folder_path(
        "Right", "Folder or pattern of the right camera's numbered images; empty for one camera only"
    )
    files_fps: number(
        "Rate (Hz)", "Frame rate at which the images were taken, unless their names contain the times", 30, 1, 500
    )
    calibration: file_path("Calibration", "Calibration file of the two cameras (TOML)")
    ignored_places: string("Ignored Places", "Reflections that are not markers, until a calibration file holds them")

    # Cameras panel: board and floor
    board_kind: choice(
        "Board",
        "Pattern printed on the board",
        (
            ("CHESSBOARD", "Chessboard", "Plain squares; must be fully visible"),
            ("CHARUCO", "ChArUco", "Squares with markers; may be partly hidden"),
        ),
    )
    board_columns: whole_number(
        "Columns", "Inner corners of a chessboard per row, or squares of a ChArUco board", 9, 3, 50
    )
    board_rows: whole_number(
        "Rows", "Inner corners of a chessboard per column, or squares of a ChArUco board", 6, 3, 50
    )
    board_square_mm: number("Square (mm)", "Side of a square, measured on the print", 24, 1, 1000)
    board_code_mm: number(
        "Marker (mm)", "Side of a printed marker, measured on the print; smaller than its square", 18, 1, 1000
    )
    board_dictionary: choice(
        "Dictionary",
        "Dictionary of the printed markers",
        tuple(
            (name, name.removeprefix("DICT_"), "Marker grid size and number of markers in the dictionary")
            for name in BOARD_CODES
        ),
    )
    board_views: whole_number(
        "Max Views", "Stop after this many views of the board even if the result is not good", 40, 3, 200
    )
    board_timed: switch("Timed", "Take views after a countdown instead of when the board is held still")
    board_every_s: duration("Every", "Time to move the board between two views", 3, 0.5, 60)
    floor_height_mm: number(
        "Height (mm)", "Height of a marker's centre above the floor: the radius of a ball", 12.5, 0, 200
    )
    floor_longest_mm: number(
        "Span (mm)",
        "Distance between the centres of the two markers farthest apart; scales the calibration. "
        "0 keeps the calibration's scale",
        0,
        0,
        20000,
    )
    board_left: folder_path("Board Left", "Folder with the left camera's images of the board")
    board_right: folder_path("Board Right", "Folder with the right camera's images of the board")

    # Markers panel
    marker_set: dynamic_choice("Set", "Markers on the performer", lambda _context: _marker_set_items())
    marker_set_file: file_path("File", "Custom marker set (TOML); empty for the set above")
    threshold_auto: switch("Auto", "Choose the brightness threshold from the learned background", default=True)
    threshold: number(
        "Threshold", "Grey levels by which a marker's pixels must exceed the learned background", 38, 1, 255
    )
    background_s: duration(
        "Background", "Time at the start of a capture for learning the empty view: stay out of sight", 2, 0.1, 60
    )

    # Subject panel
    subject: file_path("Subject", "Calibrated performer (TOML); empty for the simulated performer")
    subject_name: string("Name", "Name of the performer to calibrate", "Performer")
    countdown_s: duration(
        "Countdown",
        "Time to walk in front of the cameras and take the T pose, after the background is learned",
        8,
        0,
        60,
    )
    between_s: duration("Next Pose", "Time from one calibration pose to the next", 5, 1, 60)
    subject_height: number("Height (m)", "Height of the performer", 1.75, 1.2, 2.3)
    subject_take: file_path("Take", "Marker take of the calibration poses, T pose first")
    take_poses: switch(
        "All Three Poses", "The take shows T pose, hanging arms and motorcycle pose; otherwise only the T pose"
    )

    # Motion Database panel
    database: file_path("Database", "Motion database (.pfdb); empty for the starter database")
    database_fps: number("Rate (Hz)", "Frames per second of imported motion in the database", 60, 5, 240)

    # Character and Capture panels
    armature: armature_pointer("Armature to animate; empty adds a new character at the start")
    capture_preview: switch(
        "Preview",
        "Show the camera images while capturing. Markers, or points of the person, are green if seen by both "
        "cameras, orange by one; others are red",
    )
    overlay: choice(
        "Overlay",
        "Drawn over the 3D viewports while live, with the solver's confidence. Shift-click for several",
        OVERLAYS,
        default={"MARKERS", "GHOST"},
        options={"ENUM_FLAG"},
    )
    record_by_button: switch(
        "Record by Button", "Rehearse until Record is clicked; each recording becomes a separate action"
    )
    record_countdown_s: whole_number(
        "Countdown",
        "Seconds from the first pose to the recording; the character already moves. 0 starts at once",
        0,
        0,
        60,
        subtype="TIME_ABSOLUTE",
    )
    record_sound: switch("Sound", "Beep every second of the countdown, and higher at its end", default=True)
    record_signal: choice("Signal", "Signal of the performer that starts or stops the recording", _SIGNALS, "NONE")
    record_length_s: bpy.props.FloatProperty(
        name="Stop After",
        description="Length of the recording, after which the capture stops. 0 for no limit",
        default=0,
        min=0,
        soft_max=600,
        subtype="TIME_ABSOLUTE",
    )
    immediate: switch(
        "Immediate",
        "Show each pose as soon as it is solved. Otherwise it is shown two frames later, smoothed with the poses "
        "around it. Recordings are always smoothed in this way",
        update=_retune,
    )
    smoothing_ms: number(
        "Smoothing (ms)",
        "Removes jitter. Adds up to this much delay; less during fast motion. 0 turns it off. The take "
        "keeps the unfiltered motion",
        0,
        0,
        200,
        precision=0,
        step=100,
        update=_retune,
    )
    feet: choice(
        "Feet",
        "Foot lock: keeps standing feet in place. The take keeps the unfiltered motion",
        FEET,
        "auto",
        update=_retune,
    )
    body_parts: choice(
        "Body Parts",
        "Parts of the body to animate, Shift-click for several; the others keep their own animation",
        BODY_PARTS,
        default={key for key, *_ in BODY_PARTS},
        options={"ENUM_FLAG"},
    )
    extend_scene: switch("Extend Scene", "Extend the scene if the recording is longer", default=True)


def chosen_gesture(chosen: PERFANIM_PG_settings) -> Gesture | None:
    """Return the performer's signal for starting and stopping, or None."""
    return None if chosen.record_signal == "NONE" else Gesture[chosen.record_signal]


def settings(context: bpy.types.Context) -> PERFANIM_PG_settings:
    """Return the scene's settings."""
    return context.scene.perfanim

"""Settings of the simulated cameras and their room."""

from dataclasses import dataclass

from ...errors import SettingsError
from ...system.assets import STUDIO
from ...system.files import read_toml

TABLES = read_toml(STUDIO)  # colours, body and furniture


@dataclass(frozen=True)
class StudioSettings:
    """Settings of the images; by default those of good webcams with ring lights.

    Retro-reflective markers reflect the ring light, so the exposure is short and everything else is dim.

    Args:
        marker_radius_m: Radius of the spherical markers.
        marker_brightness: Grey level of a marker's image, 0-255, before noise.
        marker_colours: Colour (B, G, R) of each marker, 0-255; markers not listed are grey, with `marker_brightness`.
        lens_blur_px: Standard deviation of the blur with which the lens images markers.
        exposure_s: Exposure time, centred on the frame's time; it smears moving markers.
        noise_sigma: Standard deviation of the sensor's Gaussian noise, grey levels.
        light: Brightness of room and body (lamps stay bright), relative to the pictures of the board.
        time_offsets_s: Delay of each camera relative to its time stamps; 0 for cameras not listed.
        rolling_shutter_s: Time from the first row to the last; the middle row is exposed at the frame's time.
        clutter: Show furniture, lamps and pictures.
        ghosts: Number of false bright blobs that wander through each image (reflections).
        moved_object: Show a box that is missing from the background images.
        light_drift: Amplitude of a slow change of the room's light, as a fraction of its brightness.
        draw_body: Show the performer's body.
        occlusion: Let bodies and markers hide markers.
        dropout: Probability (0 to 1) that a marker is missing in an image.
        seed: Seed of noise, ghosts and dropout.
    """

    marker_radius_m: float = 0.0125
    marker_brightness: float = 240.0
    marker_colours: tuple[tuple[float, float, float], ...] = ()
    lens_blur_px: float = 0.5
    exposure_s: float = 0.0
    noise_sigma: float = 2.0
    light: float = 0.4
    time_offsets_s: tuple[float, ...] = ()
    rolling_shutter_s: float = 0.0
    clutter: bool = True
    ghosts: int = 0
    moved_object: bool = False
    light_drift: float = 0.0
    draw_body: bool = True
    occlusion: bool = True
    dropout: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        limits = {
            "marker_radius_m": (0.001, 0.1),
            "marker_brightness": (0.0, 255.0),
            "lens_blur_px": (0.0, 5.0),
            "exposure_s": (0.0, 0.1),
            "noise_sigma": (0.0, 50.0),
            "light": (0.0, 1.0),
            "rolling_shutter_s": (0.0, 0.1),
            "ghosts": (0, 50),
            "light_drift": (0.0, 0.5),
            "dropout": (0.0, 1.0),
        }
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise SettingsError(
                    f"{getattr(self, name)} is out of range", where=name, advice=f"give {low} to {high}"
                )

    def time_offset_s(self, camera: int) -> float:
        """Return the time offset of a camera, seconds."""
        return self.time_offsets_s[camera] if camera < len(self.time_offsets_s) else 0.0

"""Check for impossible lenses, which indicate a failed calibration or another lens model."""

from dataclasses import dataclass

import numpy as np

from .camera import Camera


@dataclass(frozen=True)
class LensLimits:
    """Limits for lenses that the standard model describes."""

    widest_deg: float = 150.0  # widest field of view; rectilinear lenses reach 120, and beyond 150 the model is useless
    narrowest_deg: float = 0.5  # field of view
    stretched: float = 2.0  # largest ratio of the two focal lengths; anamorphic lenses reach 2
    # distance from the centre, as a share of half the shorter side, within which the distortion must not fold the image
    clear: float = 0.5


LIMITS = LensLimits()


def lens_fault(camera: Camera) -> str:
    """Return why a camera's lens is impossible, or "" if it is plausible."""
    focal = np.array([camera.matrix[0, 0], camera.matrix[1, 1]])
    size = np.array(camera.image_size, dtype=np.float64)
    field_deg = float(np.degrees(2.0 * np.arctan(np.max(0.5 * size / focal))))
    if not LIMITS.narrowest_deg < field_deg < LIMITS.widest_deg:
        return f"has a field of view of {field_deg:.3g} degrees, which no lens of this model has"
    if np.max(focal) > LIMITS.stretched * np.min(focal):
        return f"has focal lengths {focal[0]:.4g} and {focal[1]:.4g} pixels, a ratio that no lens has"
    centre = camera.matrix[:2, 2]
    if np.any(centre < -0.5 * size) or np.any(centre > 1.5 * size):
        return f"has its optical axis at pixel {centre[0]:.0f}, {centre[1]:.0f}, far outside the image"
    k1, k2, _, _, k3 = camera.distortion
    radius = np.linspace(0.0, 4.0 * float(np.max(0.5 * size / focal)), 400)
    reached = radius * (1.0 + k1 * radius**2 + k2 * radius**4 + k3 * radius**6)
    falls = np.flatnonzero(np.diff(reached) < 0.0)
    if len(falls) and reached[falls[0]] < LIMITS.clear * 0.5 * float(np.min(size / focal)):
        return "has a distortion that folds the image over itself"
    return ""

"""Figures of a calibration, for people and programs."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .calibrate import CalibrationResult


def calibration_summary(result: "CalibrationResult", square_m: float = 0.0) -> dict[str, Any]:
    """Return a calibration's summary; `square_m` is the board's square, 0 if unknown."""
    summary: dict[str, Any] = {
        "verdict": result.verdict,
        "stereo_rms_px": result.stereo_rms_px,
        "held_out_rms_px": result.held_out_px,
        "rms_px": dict(result.rms_px),
        "coverage": dict(result.coverage),
        "used": len(result.used),
        "rejected": [{"picture": row.picture, "reason": row.reason} for row in result.rejected],
        "views_px": {
            name: {picture: error for (picture, camera), error in result.views_px.items() if camera == name}
            for name in result.rms_px
        },
        "advice": list(result.advice),
    }
    if len(result.rig) > 1:
        summary["baseline_mm"] = result.baseline_m * 1000.0
        summary["distance_sigma_percent"] = 100.0 * result.distance_sigma
    if result.late_s:
        summary["late_ms"] = {name: 1000.0 * late for name, late in result.late_s.items()}
    if square_m and len(result.rig) > 1:
        summary["baseline_squares"] = result.baseline_m / square_m
    return summary

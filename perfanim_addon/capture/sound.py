"""Beeps for performers who are far from the screen."""

from contextlib import suppress

from .tuning import TUNING


def beep(hertz: float) -> None:
    """Play a short tone, if there is a sound device."""
    try:
        import aud
    except ImportError:  # this Blender was built without sound
        return
    with suppress(aud.error):
        aud.Device().play(aud.Sound.sine(hertz).limit(0.0, TUNING.beep_s))

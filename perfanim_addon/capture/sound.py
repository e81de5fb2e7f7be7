"""Beeps for performers far from the screen."""

from contextlib import suppress

_BEEP_S = 0.12


def beep(hertz: float) -> None:
    """Play a short tone; silence where there is no sound device."""
    try:
        import aud
    except ImportError:  # a Blender built without sound
        return
    with suppress(aud.error):
        aud.Device().play(aud.Sound.sine(hertz).limit(0.0, _BEEP_S))

"""Python errors in a program's output."""

_WORDS = ("Traceback", "Exception ignored", "ResourceWarning")


def errors_in(text: str) -> list[str]:
    """Return the Python errors that were printed."""
    return [text[max(text.find(word) - 200, 0) :][:1500] for word in _WORDS if word in text]

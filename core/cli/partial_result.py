"""Summaries of work that may have failed in part."""

from typing import Any


class PartialResult(dict[str, Any]):
    """A summary with a text of its own for people.

    Args:
        text: printed without --json.
        failure: one line for stderr, and exit status 1; "" for none.
    """

    def __init__(self, summary: dict[str, Any], text: str, failure: str = "") -> None:
        super().__init__(summary)
        self.text = text
        self.failure = failure

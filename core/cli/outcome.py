"""Summaries of work of which a part may have failed."""

from typing import Any


class PartialResult(dict[str, Any]):
    """A summary with a text of its own for people.

    Args:
        summary: as any command's.
        text: what is printed without --json.
        failure: one line for stderr, with which the exit status is 1; "" when all is well.
    """

    def __init__(self, summary: dict[str, Any], text: str, failure: str = "") -> None:
        super().__init__(summary)
        self.text = text
        self.failure = failure

"""Notes on solved poses, each with a kind for programs and a sentence for people and files."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, auto

from .body_parts import PARTS


class NoteKind(Enum):
    """Kinds of notes on a pose."""

    SOURCE = auto()  # message from a camera, or another source of marker frames
    HIDDEN = auto()  # markers or a prop are hidden
    JUMPED = auto()  # markers moved faster than a body can, and are not used yet
    FROZEN = auto()  # markers stand exactly still while the body moves, and are not used
    EXCHANGED = auto()  # markers had each other's labels, which were corrected
    UNCERTAIN = auto()  # a part of the body has a large expected error
    UNFAMILIAR = auto()
    HELD = auto()
    WAITING = auto()
    REFUSED = auto()
    # Why the solver started over; these are noted on the first pose after that.
    TIMES_JUMPED = auto()
    TORSO_LOST = auto()
    MISFIT = auto()
    # Why a pose was solved without the motion before it.
    CUT = auto()
    NEARER_EXAMPLE = auto()
    OTHER_MOTION = auto()
    # Labels that the session found or changed.
    LABELLED = auto()
    LABELLED_MORE = auto()
    RELABELLED = auto()
    LABELLED_LATER = auto()  # recorded takes: labels carried back from later frames
    PRIOR_LED = auto()  # the learned prior had more weight than the examples


# Decisions of the solver are not problems: takes store them with the poses, and they are listed on request.
_DECISIONS = {
    NoteKind.TIMES_JUMPED: "started over: the times of the frames jumped",
    NoteKind.TORSO_LOST: "started over: the torso was hidden for too long",
    NoteKind.MISFIT: "started over: the markers did not fit the body for too long",
    NoteKind.CUT: "solved without history: all markers jumped, as after a cut",
    NoteKind.NEARER_EXAMPLE: "solved without history: another example is much nearer",
    NoteKind.OTHER_MOTION: "solved without history: other recorded motion explains the last markers better",
    NoteKind.LABELLED: "labels found without history",
    NoteKind.LABELLED_MORE: "more markers labelled",
    NoteKind.RELABELLED: "labels changed: others explain the markers better",
    NoteKind.LABELLED_LATER: "labels taken from later frames, where they were found",
    NoteKind.PRIOR_LED: "the learned prior counted more than the examples",
}
_SENTENCES = _DECISIONS | {
    NoteKind.UNFAMILIAR: "this motion is unlike the database",
    NoteKind.HELD: "held: the markers do not fit the body",
    NoteKind.WAITING: "waiting for the markers of the torso",
    NoteKind.REFUSED: "a frame with an impossible time was left out",
}
_JUMPED, _FROZEN, _EXCHANGED = " jumped, left out", " frozen, left out", " exchanged, put back"
_ENDINGS = {" hidden": NoteKind.HIDDEN, _JUMPED: NoteKind.JUMPED, _FROZEN: NoteKind.FROZEN}
_ENDINGS |= {_EXCHANGED: NoteKind.EXCHANGED}
_ENDINGS |= {sentence: kind for kind, sentence in _SENTENCES.items()}
# Problems that the solver reacted to.
_ACTED_ON = {
    NoteKind.JUMPED, NoteKind.FROZEN, NoteKind.EXCHANGED, NoteKind.HELD, NoteKind.WAITING, NoteKind.REFUSED,
}  # fmt: skip


@dataclass(frozen=True)
class PoseNote:
    """Note on a pose.

    Args:
        text: Sentence for people; this is all that files store.
        part: Part of the body (`body_parts.PARTS`) that the note is about; "" for the whole pose.
    """

    kind: NoteKind
    text: str
    part: str = ""

    @property
    def is_decision(self) -> bool:
        """Whether the note only says what the solver decided."""
        return self.kind in _DECISIONS

    @property
    def tells_why(self) -> bool:
        """Whether the note explains what the solver did."""
        return self.is_decision or self.kind in _ACTED_ON

    @classmethod
    def of(cls, kind: NoteKind) -> "PoseNote":
        """Return the note of a kind that always has the same sentence."""
        return cls(kind, _SENTENCES[kind])

    @classmethod
    def hidden(cls, names: Iterable[str]) -> "PoseNote":
        """Return the note that the markers or props with these names are hidden."""
        return cls(NoteKind.HIDDEN, ", ".join(names) + " hidden")

    @classmethod
    def jumped(cls, names: Iterable[str]) -> "PoseNote":
        """Return the note that the markers with these names are left out because they jumped."""
        return cls(NoteKind.JUMPED, ", ".join(names) + _JUMPED)

    @classmethod
    def frozen(cls, names: Iterable[str]) -> "PoseNote":
        """Return the note that the markers with these names are left out because they stand exactly still."""
        return cls(NoteKind.FROZEN, ", ".join(names) + _FROZEN)

    @classmethod
    def exchanged(cls, names: Iterable[str]) -> "PoseNote":
        """Return the note that the exchanged labels of the markers with these names were corrected."""
        return cls(NoteKind.EXCHANGED, ", ".join(names) + _EXCHANGED)

    @classmethod
    def uncertain(cls, part: str, reason: str) -> "PoseNote":
        """Return the note that a part of the body is uncertain."""
        return cls(NoteKind.UNCERTAIN, f"{part} uncertain: {reason}", part)

    @classmethod
    def of_text(cls, text: str) -> "PoseNote":
        """Return the note that was stored as `text`."""
        part, uncertain, _ = text.partition(" uncertain: ")
        if uncertain and part in PARTS:
            return cls(NoteKind.UNCERTAIN, text, part)
        # notes of further performers begin with their names
        return cls(next((kind for ending, kind in _ENDINGS.items() if text.endswith(ending)), NoteKind.SOURCE), text)


def source_notes(texts: Iterable[str]) -> tuple[PoseNote, ...]:
    """Return notes with the messages of a source."""
    return tuple(PoseNote(NoteKind.SOURCE, text) for text in texts)

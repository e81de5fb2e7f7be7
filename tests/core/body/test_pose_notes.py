"""Notes keep their kind when only their text is stored."""

import pytest
from perfanim.core.body.pose_notes import NoteKind, PoseNote, source_notes

NAMING = {NoteKind.SOURCE, NoteKind.HIDDEN, NoteKind.JUMPED, NoteKind.FROZEN, NoteKind.EXCHANGED, NoteKind.UNCERTAIN}
WITH_ONE_SENTENCE = [kind for kind in NoteKind if kind not in NAMING]


@pytest.mark.parametrize(
    "note",
    [
        *map(PoseNote.of, WITH_ONE_SENTENCE),
        PoseNote(NoteKind.CUT, f"Ben: {PoseNote.of(NoteKind.CUT).text}"),  # a further performer
        PoseNote.hidden(["left hand", "left foot"]),
        PoseNote.jumped(["left hand"]),
        PoseNote.frozen(["left hand"]),
        PoseNote.exchanged(["left foot", "right foot"]),
        PoseNote.uncertain("left arm", "its marker is hidden"),
        *source_notes(["the left camera froze", "this is uncertain: really"]),
    ],
)
def test_note_is_read_from_its_text(note: PoseNote) -> None:
    assert PoseNote.of_text(note.text) == note

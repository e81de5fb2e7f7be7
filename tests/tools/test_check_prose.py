"""The rules of prose are held by the check."""

import pytest
from check_prose import findings_of

GOOD = '''"""Find markers in images."""


def find(image):
    """Return the blobs of an image.

    Dark ones are left out.
    """
'''


def test_plain_prose_passes():
    assert list(findings_of(GOOD)) == []


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("Return the blobs of an image.", "Return " + "x" * 80 + ".", "80 at most"),
        ("Return the blobs of an image.", "Return the blobs of an image", "no sentence"),
        ("Return the blobs of an image.", "The blobs of an image.", "start with a verb"),
        ("Return the blobs of an image.", "Return what the image shows.", "'what'"),
        ("Dark ones", "Blobs laid on dark ones", "banned: 'laid'"),
        ("Dark ones", "Sightings of dark ones", "observations"),
        ("def find(image)", "def find(told)", "name 'told'"),
    ],
)
def test_each_rule_is_held(old, new, text):
    assert old in GOOD
    findings = [finding for _, finding in findings_of(GOOD.replace(old, new))]
    assert any(text in finding for finding in findings), findings

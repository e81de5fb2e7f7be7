"""Content of foreign files: recognising the format from the first bytes, and decoding text."""

import re

from ..errors import FormatError, PerfanimError, shorten

_HEAD = 4096  # bytes needed to recognise a file
_ASF_GUID = bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c")
# first bytes of files, from each format's standard -> name of the format
_BEGINNINGS: tuple[tuple[bytes, str], ...] = (
    (_ASF_GUID, "a video (Windows Media)"),
    (b"\x1aE\xdf\xa3", "a video (Matroska or WebM)"),
    (b"\x00\x00\x01\xba", "a video (MPEG)"),
    (b"OggS", "a video or audio file (Ogg)"),
    (b"FLV\x01", "a video (Flash)"),
    (b"ID3", "an audio file (MP3)"),
    (b"PK\x03\x04", "an archive (zip)"),
    (b"PK\x05\x06", "an archive (zip)"),
    (b"7z\xbc\xaf\x27\x1c", "an archive (7z)"),
    (b"Rar!\x1a\x07", "an archive (rar)"),
    (b"\x1f\x8b", "an archive (gzip)"),
    (b"BZh", "an archive (bzip2)"),
    (b"\xfd7zXZ\x00", "an archive (xz)"),
    (b"\x28\xb5\x2f\xfd", "an archive (zstd)"),
    (b"\x89PNG\r\n", "a picture (PNG)"),
    (b"\xff\xd8\xff", "a picture (JPEG)"),
    (b"GIF8", "a picture (GIF)"),
    (b"II*\x00", "a picture (TIFF)"),
    (b"MM\x00*", "a picture (TIFF)"),
    (b"%PDF-", "a document (PDF)"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an old Microsoft Office document"),
    (b"Kaydara FBX Binary", "an FBX file"),
    (b"glTF", "a binary glTF file"),
    (b"BLENDER", "a Blender file"),
    (b"SQLite format 3\x00", "a database (SQLite)"),
    (b"\x89HDF\r\n", "an HDF5 or MATLAB file"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file"),
    (b"PERFANIM-DB", "a motion database"),
    (b"version https://git-lfs", "a Git LFS pointer instead of the file itself"),
    (b"pathfiletype", "a TRC file"),
    (b"hierarchy", "a BVH file"),
)
_BOXES = {b"AVI ": "a video (AVI)", b"WAVE": "an audio file (WAV)", b"WEBP": "a picture (WebP)"}
_WIDE_MARKS = ((b"\xff\xfe\x00\x00", "utf-32"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
_ELEMENT = re.compile(rb"<([A-Za-z][\w:.-]*)")
_COMMENTS = re.compile(rb"<!--.*?-->|<\?.*?\?>", re.DOTALL)


def content_kind(data: bytes) -> str:
    """Return what a file is according to its first bytes, such as "a web page" or "a video (AVI)"; "" if unclear."""
    head = data[:_HEAD]
    if head[4:8] in (b"ftyp", b"moov", b"mdat"):
        return "a picture (HEIF)" if head[8:12] in (b"heic", b"mif1", b"avif") else "a video (MP4 or QuickTime)"
    if head[:4] == b"RIFF":
        return _BOXES.get(head[8:12], "")
    if head[257:262] == b"ustar":
        return "an archive (tar)"
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    kind = next((kind for start, kind in _BEGINNINGS if head.startswith(start) or text.lower().startswith(start)), "")
    return kind or _markup(text)


def _markup(text: bytes) -> str:
    """Return what a text that begins with markup is; "" for other text."""
    if not text.startswith(b"<"):
        return ""
    element = _ELEMENT.search(_COMMENTS.sub(b"", text))
    name = element[1].decode() if element else ""
    if name.lower() in ("html", "head", "body") or text[:14].lower() == b"<!doctype html":
        return "a web page"
    return f"an XML file (<{shorten(name, 40)}>)" if name else ""


def check_kind(
    data: bytes,
    where: str,
    expected: str,
    kind: type[PerfanimError] = FormatError,
    container: str = "",
    advice: str = "choose the right file, or correct its extension",
) -> None:
    """Raise an error of class `kind` if a file's first bytes show that it is something else.

    Args:
        expected: What the reader expects, such as "TRC file".
        container: Format that the expected file is stored in, such as "archive (zip)".
    """
    found = content_kind(data)
    if found and (container or expected) not in found:
        raise kind(f"is {found}, not the expected {expected}", where=where, advice=advice)


def decode_text(data: bytes, where: str, expected: str, kind: type[PerfanimError] = FormatError) -> str:
    """Decode a text from UTF-8, UTF-16 or UTF-32 (recognised by byte order mark or zero bytes), or else Windows-1252.

    Args:
        expected: What the reader expects, such as "TRC file".

    Raises:
        PerfanimError: The file has another format; the class of the error is `kind`.
    """
    check_kind(data, where, expected, kind)
    encoding = _wide_encoding(data)
    if encoding:
        return data.decode(encoding, errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _wide_encoding(data: bytes) -> str:
    """Return the encoding of a text with two or four bytes per character; "" for other encodings."""
    marked = next((encoding for mark, encoding in _WIDE_MARKS if data.startswith(mark)), "")
    even, odd = data[:64:2], data[1:64:2]
    if marked or any(even) == any(odd):
        return marked
    return "utf-16-le" if any(even) else "utf-16-be"


def utf8_text(data: bytes, where: str, expected: str) -> bytes:
    """Return a text file's bytes in an encoding that contains ASCII, without byte order mark.

    Errors are those of `decode_text`. Only UTF-16 and UTF-32 are decoded, which saves time with long files.
    """
    check_kind(data, where, expected)
    encoding = _wide_encoding(data)
    return data.decode(encoding, "replace").encode() if encoding else data.removeprefix(b"\xef\xbb\xbf")


def with_decimal_points(text: bytes) -> bytes:
    """Return a text of numbers with decimal commas replaced by points; unchanged if it also has decimal points."""
    if b"," not in text or re.search(rb"\d\.\d", text):
        return text
    return re.sub(rb"(?<=\d),(?=\d)", b".", text)

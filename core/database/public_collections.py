"""Public collections of motion: which ones are known, and how they are downloaded."""

import gzip
import re
import tarfile
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path, PurePosixPath
from typing import Annotated
from urllib.parse import unquote, urlsplit

from ..errors import DownloadError, FormatError, PerfanimError, SettingsError, shorten
from ..formats.motion.motion_sources import check_count, check_unpacked_size, counted_headers
from ..geometry.npz import open_zip
from ..system.assets import COLLECTIONS
from ..system.download import check_address, download
from ..system.files import read_toml, reading
from ..system.progress import Progress
from ..system.schema import About, Schema

_EXTENSIONS = (".zip", ".tar.gz", ".tgz", ".tar", ".bvh")
_DAMAGED_ADVICE = "download it again; if that does not help, the archive itself is damaged"


@dataclass(frozen=True)
class Collection:
    """A public collection of recorded motion."""

    name: Annotated[str, About("short name; by default the table's", optional=True)]
    title: Annotated[str, About("full name", least=1)]
    page: Annotated[str, About("web page about the collection", least=1)]
    address: Annotated[str, About("address of the archive", least=1)]
    megabytes: Annotated[int, About("approximate size of the archive", "MB", 1, 1e6)]
    licence: Annotated[str, About("permitted uses of the motion", least=1)]
    good_for: Annotated[str, About("kinds of motion in the collection", least=1)]


COLLECTION = Schema(
    Collection,
    "Public collection of motion",
    "One table per collection, under the name that `perfanim database get` takes.",
    FormatError,
    "install the add-on again",
)


@cache
def public_collections() -> dict[str, Collection]:
    """Return the known collections by name."""
    return COLLECTION.read_each(read_toml(COLLECTIONS), str(COLLECTIONS))


def get_collection(name_or_address: str, folder: Path, progress: Progress) -> Path:
    """Return the archive of a collection, which is downloaded unless it is already there.

    Args:
        name_or_address: Name in `public_collections`, or the address of another archive.
        folder: Folder for archives; nothing is written elsewhere.

    Raises:
        DownloadError: The download fails or the file is damaged; see `download`.
        SettingsError: The name is unknown.
    """
    known = public_collections().get(name_or_address)
    if known is None and "/" not in name_or_address:
        raise SettingsError(
            f"there is no collection {name_or_address!r}",
            advice=f"give one of {', '.join(public_collections())}, or an address",
        )
    address = known.address if known else name_or_address
    archive = folder / file_name(address, known.name if known else "")
    if not archive.is_file():
        download(address, archive, progress)
        progress(1.0, f"checking {archive.name}")
        try:
            _check(archive)
        except PerfanimError:
            archive.unlink()
            raise
    return archive


def file_name(address: str, name: str = "") -> str:
    """Return a safe file name for an address: letters, digits, dashes, underscores and an extension."""
    check_address(address)
    last = unquote(urlsplit(address).path).rsplit("/", 1)[-1]
    extension = next((extension for extension in _EXTENSIONS if last.lower().endswith(extension)), "")
    if not extension:
        raise DownloadError(
            "is not the address of a motion archive",
            where=address,
            advice=f"give the address of a file with one of the extensions {', '.join(_EXTENSIONS)}",
        )
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", name or last[: -len(extension)])[:80].strip("-")
    return f"{stem or 'motion'}{extension}"


def _check(archive: Path) -> None:
    """Raise PerfanimError if an archive is damaged or dangerous to unpack."""
    if archive.suffix == ".bvh":
        return
    with reading(archive, DownloadError, _DAMAGED_ADVICE):
        if archive.suffix == ".zip":
            _check_zip(archive)
        else:
            _check_tar(archive)


def _check_zip(archive: Path) -> None:
    with archive.open("rb") as file, open_zip(file, partial(check_count, archive)) as opened:
        _check_names(archive, opened.namelist())
        check_unpacked_size(archive, sum(member.file_size for member in opened.infolist()))
        bad = opened.testzip()
        if bad is not None:
            raise DownloadError(f"is damaged at {shorten(bad, 60)}", where=str(archive), advice=_DAMAGED_ADVICE)


def _check_tar(archive: Path) -> None:
    # gzip is opened here, because tarfile does not verify the checksum at the end of the file
    with archive.open("rb") if archive.suffix == ".tar" else gzip.open(archive) as stream:
        size = 0
        with tarfile.open(fileobj=stream, mode="r|", tarinfo=counted_headers(archive)) as opened:
            for member in opened:
                size += member.size
                check_unpacked_size(archive, size)
                _check_names(archive, [member.name])
        while piece := stream.read(1 << 20):
            size += len(piece)
            check_unpacked_size(archive, size)


def _check_names(archive: Path, names: Iterable[str]) -> None:
    for name in names:
        path = PurePosixPath(name.replace("\\", "/"))
        if path.is_absolute() or ".." in path.parts or re.match(r"[A-Za-z]:", name):
            raise DownloadError(
                f"contains a file that would be unpacked outside its folder ({shorten(name, 60)})",
                where=str(archive),
                advice="download it from another source",
            )

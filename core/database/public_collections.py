"""Public collections of motion: their list, and one from the network."""

import re
import zipfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit

from ..errors import DownloadError, SettingsError
from ..system.assets import COLLECTIONS
from ..system.download import check_address, download
from ..system.files import read_toml, reading
from ..system.progress import Progress

_ENDINGS = (".zip", ".tar.gz", ".tgz", ".tar", ".bvh")
_LONGEST_NAME = 80
_DAMAGED_ADVICE = "get it again; if that does not help, it is damaged where it comes from"


@dataclass(frozen=True)
class Collection:
    """A public collection of recorded motion.

    Args:
        name: as `perfanim database get` takes it.
        page: address to read about it.
        address: of the archive.
        megabytes: about the size of the archive.
        licence: what may be done with the motion, in plain words.
        good_for: kinds of motion in it.
    """

    name: str
    title: str
    page: str
    address: str
    megabytes: int
    licence: str
    good_for: str


@cache
def public_collections() -> dict[str, Collection]:
    """Return the collections that are offered, by name."""
    with reading(COLLECTIONS, advice="install the add-on again"):
        return {name: Collection(name, **facts) for name, facts in read_toml(COLLECTIONS).items()}


def get_collection(name_or_address: str, folder: Path, progress: Progress) -> Path:
    """Return the archive of a collection, got from the network where it is missing.

    Args:
        name_or_address: of `public_collections`, or an address of one's own.
        folder: of the archives; nothing is written elsewhere.

    Raises:
        DownloadError: it cannot be had, or what came is damaged; see `download`.
        SettingsError: there is no collection of this name.
    """
    known = public_collections().get(name_or_address)
    if known is None and "/" not in name_or_address:
        raise SettingsError(
            f"there is no collection {name_or_address!r}",
            advice=f"give {', '.join(public_collections())} or an address",
        )
    address = known.address if known else name_or_address
    archive = folder / file_name(address, known.name if known else "")
    if not archive.is_file():
        download(address, archive, progress)
        progress(1.0, f"checking {archive.name}")
        try:
            _check(archive)
        except DownloadError:
            archive.unlink()
            raise
    return archive


def file_name(address: str, name: str = "") -> str:
    """Return the name for the file at an address: of letters, digits, dots and dashes."""
    check_address(address)
    last = unquote(urlsplit(address).path).rsplit("/", 1)[-1]
    ending = next((ending for ending in _ENDINGS if last.lower().endswith(ending)), "")
    if not ending:
        raise DownloadError(
            "is no archive of motion", where=address, advice=f"give the address of a file that ends in {_ENDINGS[0]}"
        )
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", name or last[: -len(ending)])[:_LONGEST_NAME].strip("-")
    return f"{stem or 'motion'}{ending}"


def _check(archive: Path) -> None:
    """Raise DownloadError where an archive's bytes differ from its checksums."""
    if archive.suffix != ".zip":
        return  # its end is missed when it is read
    with reading(archive, DownloadError, _DAMAGED_ADVICE), zipfile.ZipFile(archive) as opened:
        bad = opened.testzip()
        if bad is not None:
            raise DownloadError(f"is damaged at {bad}", where=str(archive), advice=_DAMAGED_ADVICE)

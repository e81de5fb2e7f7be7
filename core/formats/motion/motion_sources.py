"""Motion files in folders and archives, with the skeleton of each AMC file."""

import shutil
import tarfile
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path, PurePosixPath

from ...errors import FormatError
from ...geometry.npz import open_zip
from ...system.files import is_file, is_folder, is_over_budget, read_bytes, reading

MOTION_SUFFIXES = frozenset((".bvh", ".amc"))
_USED_SUFFIXES = MOTION_SUFFIXES | {".asf"}
_INDEX_NAME = "index.tsv"
_NAME_TYPES = frozenset((*tarfile.GNU_TYPES, tarfile.XHDTYPE, tarfile.XGLTYPE, tarfile.SOLARIS_XHDTYPE)) - {
    tarfile.GNUTYPE_SPARSE
}
_TAR_SUFFIXES = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz")


@dataclass(frozen=True)
class MotionFile:
    """One motion file on disk.

    Args:
        name: Path inside its source, preceded by the source's own name ("cmu.tar.xz/14/14_02.amc").
        skeleton: ASF file of an AMC file; None if there is none.
        description: Description from an index.tsv next to it, or "".
    """

    name: str
    path: Path
    skeleton: Path | None
    description: str

    @property
    def stem(self) -> str:
        """File name without folder and suffix."""
        return PurePosixPath(self.name).stem


@contextmanager
def motion_files(sources: Sequence[Path | str]) -> Iterator[list[MotionFile]]:
    """Yield all BVH and AMC files in files, folders and archives, sorted.

    Archives are unpacked to a temporary folder that is removed when the context ends.

    Raises:
        FormatError: A source is missing, of another kind, or a damaged archive.
    """
    with tempfile.TemporaryDirectory(prefix="perfanim-") as scratch:
        found: dict[str, Path] = {}
        for number, source in enumerate(sources):
            for name, path in _members(Path(source), Path(scratch) / str(number)).items():
                taken = found.get(name, path) != path  # two sources have the same name
                found[f"{Path(source).parent.as_posix()}/{name}" if taken else name] = path
        yield _pair_skeletons(found)


def is_archive(name: str) -> bool:
    """Return whether a file name has the extension of an archive that can be read."""
    return name.lower().endswith((".zip", *_TAR_SUFFIXES))


def _members(source: Path, scratch: Path) -> dict[str, Path]:
    """Return name -> path of the motion, skeleton and index files in one source."""
    if is_folder(source):
        paths = sorted(path for path in source.rglob("*") if _is_used(path.name) and path.is_file())
        return {f"{source.name}/{path.relative_to(source).as_posix()}": path for path in paths}
    if not is_file(source):
        raise FormatError("does not exist", where=str(source), advice="give files, folders or archives")
    lower = source.name.lower()
    if is_archive(lower):
        scratch.mkdir()
        unpack = _unpack_zip if lower.endswith(".zip") else _unpack_tar
        with reading(source, what="is a damaged archive"):
            return dict(sorted(unpack(source, scratch).items()))
    if not _is_used(lower):
        raise FormatError(
            "is neither motion nor an archive of motion", where=str(source), advice="give a .bvh, .amc, .zip or .tar.*"
        )
    beside = {path.name: path for path in source.parent.glob("*") if path.suffix.lower() == ".asf"}
    index = source.parent / _INDEX_NAME
    return {source.name: source} | beside | ({_INDEX_NAME: index} if is_file(index) else {})


def _is_used(name: str, is_packed: bool = False) -> bool:
    """Return whether a file is used; nested archives are included, so that an error can name them."""
    if is_packed and is_archive(name):
        return True
    return PurePosixPath(name).suffix.lower() in _USED_SUFFIXES or PurePosixPath(name).name == _INDEX_NAME


def _unpack_zip(source: Path, scratch: Path) -> dict[str, Path]:
    found: dict[str, Path] = {}
    with source.open("rb") as file, open_zip(file, partial(check_count, source)) as archive:
        check_unpacked_size(source, sum(member.file_size for member in archive.infolist()))
        for member in archive.infolist():
            if not member.is_dir() and _is_used(member.filename, is_packed=True):
                target = _target(scratch, len(found), member.filename)
                with archive.open(member) as packed, target.open("wb") as plain:
                    shutil.copyfileobj(packed, plain)
                found[f"{source.name}/{member.filename}"] = target
    return found


def _unpack_tar(source: Path, scratch: Path) -> dict[str, Path]:
    found: dict[str, Path] = {}
    # read as a stream, because a compressed archive cannot seek back
    with tarfile.open(source, mode="r|*", tarinfo=counted_headers(source)) as archive:
        size = 0
        for member in archive:
            size += member.size
            check_unpacked_size(source, size)
            is_used = member.isfile() and _is_used(member.name, is_packed=True)
            packed = archive.extractfile(member) if is_used else None
            if packed is not None:
                target = _target(scratch, len(found), member.name)
                with target.open("wb") as plain:
                    shutil.copyfileobj(packed, plain)
                found[f"{source.name}/{member.name}"] = target
    return found


def counted_headers(source: Path, longest_name: int = 1 << 16) -> type[tarfile.TarInfo]:
    """Return a class of tar headers that rejects archives with too many headers or too long names."""
    numbers = count(1)

    class Header(tarfile.TarInfo):
        @classmethod
        def frombuf(cls, buf: bytes | bytearray, encoding: str, errors: str) -> "Header":
            check_count(source, next(numbers))
            header = super().frombuf(buf, encoding, errors)
            if header.type in _NAME_TYPES and header.size > longest_name:  # tarfile would read all of it
                raise ValueError(f"a file name has {header.size} bytes")
            return header

    return Header


def check_count(source: Path, members: int) -> None:
    """Raise FormatError if an archive holds far too many files for its size (1000, plus one for each 256 bytes)."""
    if members > 1000 + source.stat().st_size // 256:
        raise FormatError(
            "holds far more files than its size allows", where=str(source), advice="unpack it, and give the folder"
        )


def check_unpacked_size(source: Path, size: int, most_times: int = 50) -> None:
    """Raise FormatError if an archive unpacks to far more than its own size.

    Args:
        most_times: Largest allowed ratio; motion as text compresses to a fifth, at best to a twentieth.
    """
    if is_over_budget(size, source.stat().st_size, most_times):
        raise FormatError(
            "unpacks to far more than its size allows", where=str(source), advice="unpack it, and give the folder"
        )


def _target(scratch: Path, number: int, name: str) -> Path:
    # the archive's own paths could lead out of the folder
    return scratch / f"{number}{PurePosixPath(name).suffix.lower()}"


def _pair_skeletons(found: dict[str, Path]) -> list[MotionFile]:
    skeletons = SkeletonNames(name for name in found if name.lower().endswith(".asf"))
    descriptions: dict[str, str] = {}
    for name, path in found.items():
        if PurePosixPath(name).name == _INDEX_NAME:
            descriptions |= _descriptions(path)
    files = []
    seen: set[Path] = set()
    for name, path in found.items():
        pure = PurePosixPath(name)
        suffix = pure.suffix.lower()
        if (suffix not in MOTION_SUFFIXES and not is_archive(name)) or (resolved := path.resolve()) in seen:
            continue
        seen.add(resolved)
        skeleton = skeletons.of(name) if suffix == ".amc" else None
        files.append(MotionFile(name, path, found[skeleton] if skeleton else None, descriptions.get(pure.stem, "")))
    return files


class SkeletonNames:
    """Names of ASF files, looked up by the names of their AMC files."""

    def __init__(self, names: Iterable[str]) -> None:
        self._first: dict[tuple[PurePosixPath | None, str], str] = {}  # folder (None: any) and stem -> first name
        self._only: dict[PurePosixPath, str | None] = {}  # folder -> its only name, None if it has several
        for name in names:
            pure = PurePosixPath(name)
            for folder in (pure.parent, None):
                self._first.setdefault((folder, pure.stem.lower()), name)
            self._only[pure.parent] = None if pure.parent in self._only else name

    def of(self, motion: str) -> str | None:
        """Return the name of the ASF file that belongs to an AMC file.

        It has the same stem, or the stem up to the last underscore ("14_02" -> "14"), in the same folder or else
        anywhere; otherwise it is the only one in the folder.
        """
        pure = PurePosixPath(motion)
        stems = (pure.stem.lower(), pure.stem.rsplit("_", 1)[0].lower())
        found = (self._first.get((folder, stem)) for folder in (pure.parent, None) for stem in stems)
        return next(filter(None, found), self._only.get(pure.parent))


def _descriptions(path: Path) -> dict[str, str]:
    """Return trial -> description from a table with columns of these names, at most 4 MiB long."""
    lines = read_bytes(path, 4 << 20).decode("utf-8", "replace").splitlines()
    header = lines[0].lower().split("\t") if lines else []
    if "trial" not in header or "description" not in header:
        return {}
    trial, description = header.index("trial"), header.index("description")
    rows = [line.split("\t") for line in lines[1:]]
    return {row[trial]: row[description].strip() for row in rows if len(row) == len(header)}

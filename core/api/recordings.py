"""Recordings among files and folders: marker takes, and films or pictures of calibrated cameras."""

import os
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from ..errors import PerfanimError, TakeError, counted
from ..formats.markers.marker_files import READABLE
from ..geometry.camera import CameraRig
from ..geometry.rig_file import CALIBRATION_ENDINGS, load_rig
from ..system.files import is_file, is_folder
from ..vision.sources.file_endings import IMAGE_SUFFIXES, VIDEO_ENDINGS
from ..vision.sources.image_files import natural_key

_LAST_WORD = re.compile(r"[_-]([A-Za-z]*\d{0,2})$")  # of a picture's name: its camera, if one folder holds all
_MOST_BYTES = 1 << 20  # no calibration is larger; a folder may hold other files with such an extension


@dataclass(frozen=True)
class FilmedTake:
    """Films or pictures of one take.

    Args:
        name: Name of the take, after its files or their folder.
        sources: A film, a folder or a pattern of pictures for each camera, in the order of the calibration.
        calibration: File of the cameras.
    """

    name: str
    sources: tuple[str, ...]
    calibration: Path
    rig: CameraRig


def find_recordings(
    paths: Sequence[Path | str], calibration: Path | str | None = None
) -> tuple[list[Path], FilmedTake | None]:
    """Return the marker takes among files and folders, and the films or pictures, which are one take.

    A folder stands for the pictures in it, or else for the folders of pictures, the films or the marker takes in it. If
    only some of the cameras are named, the others are looked for beside them. So is the calibration, if it is neither
    given nor among the paths.

    Raises:
        TakeError: There is nothing to import, the cameras are not those of the calibration, or there is no calibration.
    """
    takes, sources, calibrations = _sort([Path(path) for path in paths])
    if not sources:
        if not takes:
            raise TakeError(
                "no takes, films or pictures were found",
                where=", ".join(map(str, paths)) or "import",
                advice="choose marker takes, the cameras' films, or folders of pictures",
            )
        return takes, None
    file, rig = _calibration(calibration, calibrations, sources)
    sources = _in_order(_all_sources(sources, len(rig)), rig, file)
    return takes, FilmedTake(_name(sources), tuple(map(str, sources)), file, rig)


def _sort(paths: Iterable[Path]) -> tuple[list[Path], list[Path], list[Path]]:
    """Return marker takes, sources and calibrations; a folder with neither pictures nor films stands for its takes."""
    takes, sources, calibrations = list[Path](), list[Path](), list[Path]()
    for path in paths:
        if is_folder(path):
            if _pictures(path):
                sources.append(path)
                continue
            inside = sorted(path.iterdir(), key=natural_key)
            sources += [each for each in inside if is_folder(each) and _pictures(each)]
            sources += [each for each in inside if _is_film(each)]
            takes += [each for each in inside if not sources and is_file(each) and _is_take(each)]
        elif path.suffix.lower() in IMAGE_SUFFIXES:
            sources.append(path.parent)
        elif _is_film(path):
            sources.append(path)
        elif path.suffix.lower() in CALIBRATION_ENDINGS:
            calibrations.append(path)
        else:
            takes.append(path)
    return list(dict.fromkeys(takes)), list(dict.fromkeys(sources)), calibrations


def _calibration(named: Path | str | None, found: Sequence[Path], sources: Sequence[Path]) -> tuple[Path, CameraRig]:
    """Return the calibration that is given, or else the first one beside the sources or in the folder above."""
    if named or found:
        file = Path(named or found[0])
        return file, load_rig(file)
    folders = dict.fromkeys(folder for source in sources for folder in (source, source.parent, source.parent.parent))
    for folder in folders:
        for file in sorted(folder.iterdir()) if is_folder(folder) else []:
            if file.suffix.lower() in CALIBRATION_ENDINGS and is_file(file) and file.stat().st_size < _MOST_BYTES:
                with suppress(PerfanimError):
                    return file, load_rig(file)
    raise TakeError(
        "the calibration of the cameras is missing",
        where=str(sources[0]),
        advice="choose its file together with the films or pictures, or put it beside them",
    )


def _all_sources(sources: list[Path], cameras: int) -> list[Path]:
    """Return the sources of all cameras, where only some are named."""
    if len(sources) >= cameras:
        return sources
    if len(sources) == 1 and is_folder(sources[0]):
        patterns = _patterns(sources[0])
        if len(patterns) == cameras:
            return patterns
    beside = sorted(sources[0].parent.iterdir(), key=natural_key)
    alike = [each for each in beside if (_pictures(each) if is_folder(sources[0]) else _is_film(each))]
    return alike if len(alike) == cameras else sources


def _patterns(folder: Path) -> list[Path]:
    """Return a pattern for each camera of a folder that holds the pictures of several, by the end of their names."""
    cameras: dict[tuple[str, str], int] = {}
    for picture in _pictures(folder):
        word = _LAST_WORD.search(picture.stem)
        key = (word[0] if word else "", picture.suffix)
        cameras[key] = cameras.get(key, 0) + 1
    if any(not word for word, _ in cameras) or min(cameras.values(), default=0) < 2:
        return []
    return [folder / f"*{word}{ending}" for word, ending in sorted(cameras)]


def _in_order(sources: list[Path], rig: CameraRig, file: Path) -> list[Path]:
    """Return the sources in the order of the cameras, whose names they contain, or else in that of their own names."""
    if len(sources) != len(rig):
        raise TakeError(
            f"shows {counted(len(rig), 'camera')}, but there are films or pictures of {len(sources)}",
            where=str(file),
            advice="choose one film or folder of pictures for each of its cameras",
        )
    named = [[source for source in sources if camera.name.lower() in source.name.lower()] for camera in rig.cameras]
    if all(len(found) == 1 for found in named) and len({found[0] for found in named}) == len(rig):
        return [found[0] for found in named]
    return sorted(sources, key=natural_key)


def _name(sources: Sequence[Path]) -> str:
    """Return the start that the films' names share, or the name of the folder that holds all pictures."""
    if sources[0].suffix and not is_folder(sources[0]) and "*" not in sources[0].name:
        stems = [source.stem for source in sources]
        same = (len(set(letters)) == 1 for letters in zip(*stems, strict=False))
        shared = stems[0][: len(list(takewhile(bool, same)))].rstrip(" _-.0123456789")
        if len(shared) > 2 and shared.lower() not in ("cam", "camera"):
            return shared
    return sources[0].parent.name or "take"


def _pictures(folder: Path) -> list[Path]:
    if not is_folder(folder):
        return []
    with os.scandir(folder) as entries:
        names = [entry.name for entry in entries if entry.name.lower().endswith(IMAGE_SUFFIXES)]
    return [folder / name for name in sorted(names) if not name.startswith(".")]


def _is_film(path: Path) -> bool:
    return path.suffix.lower() in VIDEO_ENDINGS and is_file(path)


def _is_take(path: Path) -> bool:
    return path.name.lower().endswith(READABLE) and not path.name.startswith(".")

"""What files and folders hold: marker takes, or films and pictures with their calibration."""

from pathlib import Path

import pytest
from perfanim.core.api.recordings import find_recordings
from perfanim.core.errors import TakeError
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.simulate.studio.studio_rig import default_rig


def make(folder: Path, *names: str) -> list[Path]:
    files = [folder / name for name in names]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"")
    return files


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    save_rig(default_rig(), tmp_path / "cameras.toml")
    return tmp_path / "cameras.toml"


PICTURES = tuple(f"walk/{side}/{n}.png" for side in ("left", "right") for n in (1, 2))


@pytest.mark.parametrize("chosen", [("walk",), ("walk/right/1.png",), ("walk/right", "walk/left"), ("walk/left",)])
def test_pictures_are_found_from_any_of_their_places(
    tmp_path: Path, calibration: Path, chosen: tuple[str, ...]
) -> None:
    make(tmp_path, *PICTURES)
    takes, filmed = find_recordings([tmp_path / name for name in chosen])
    assert (takes, filmed is not None) == ([], True)
    assert filmed.name == "walk"
    assert filmed.sources == (str(tmp_path / "walk/left"), str(tmp_path / "walk/right"))
    assert filmed.calibration == calibration  # beside the folder of the take


def test_pictures_of_both_cameras_in_one_folder_are_told_apart(tmp_path: Path, calibration: Path) -> None:
    make(
        tmp_path, "a/1599__14-57~73_1.jpg", "a/1599__14-57~73_2.jpg", "a/1600__14-57~76_1.jpg", "a/1600__14-57~76_2.jpg"
    )
    _, filmed = find_recordings([tmp_path / "a"])
    assert filmed.sources == (str(tmp_path / "a/*_1.jpg"), str(tmp_path / "a/*_2.jpg"))


def test_films_are_in_the_order_of_the_cameras_names(tmp_path: Path, calibration: Path) -> None:
    right, left, other = make(tmp_path, "run-RIGHT.mp4", "run-left.mp4", "words.toml")
    other.write_text("a = 1")
    for chosen in ([right, left], [right], [tmp_path]):
        _, filmed = find_recordings(chosen)
        assert (filmed.name, filmed.sources) == ("run", (str(left), str(right)))


def test_a_calibration_among_the_files_or_given_goes_first(tmp_path: Path, calibration: Path) -> None:
    films = make(tmp_path / "far", "left.mp4", "right.mp4")
    save_rig(default_rig(), tmp_path / "far" / "a.toml")
    assert find_recordings([*films, calibration])[1].calibration == calibration
    assert find_recordings(films, calibration)[1].calibration == calibration
    assert find_recordings(films)[1].calibration == tmp_path / "far" / "a.toml"


def test_a_folder_of_marker_takes_stands_for_them(tmp_path: Path) -> None:
    files = make(tmp_path, "a.c3d", "b.trc", "c.docx")
    assert find_recordings([tmp_path]) == (files[:2], None)
    assert find_recordings(files[:1]) == (files[:1], None)


def test_missing_parts_are_told(tmp_path: Path) -> None:
    films = make(tmp_path, "deep/deeper/run/a.mp4", "deep/deeper/run/b.mp4", "deep/deeper/run/c.mp4")
    with pytest.raises(TakeError, match=r"a\.mp4: the calibration of the cameras is missing; choose its file"):
        find_recordings(films)
    save_rig(default_rig(), films[0].parent / "cameras.toml")
    with pytest.raises(TakeError, match="shows 2 cameras, but there are films or pictures of 3"):
        find_recordings(films)
    with pytest.raises(TakeError, match="no takes, films or pictures were found"):
        find_recordings([films[0].parent / "cameras.toml"])

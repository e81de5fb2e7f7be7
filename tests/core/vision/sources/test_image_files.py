from pathlib import Path

import cv2
import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.vision.sources.image_file_source import ImageFileSource
from perfanim.core.vision.sources.image_files import by_number, list_images, pair_by_number
from perfanim.core.vision.sources.image_set import ImageSet


def write(folder: Path, *names: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for i, name in enumerate(names):
        cv2.imwrite(str(folder / name), np.full((24, 32, 3), 10 * i, np.uint8))


def test_files_are_ordered_by_number(tmp_path):
    write(tmp_path, "10_a.png", "9_a.png", "100_a.png")
    (tmp_path / "notes.txt").write_text("no picture")
    assert [path.name for path in list_images(tmp_path)] == ["9_a.png", "10_a.png", "100_a.png"]
    assert [path.name for path in list_images(f"{tmp_path}/1*_a.png")] == ["10_a.png", "100_a.png"]
    with pytest.raises(CaptureError, match="no image files"):
        list_images(tmp_path / "nothing")


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (["9_x_1.jpg", "10_x_1.jpg"], ["9_x_2.jpg", "10_x_2.jpg"]),  # leading number, camera last
        (["left09.png", "left10.png"], ["right09.png", "right10.png"]),
        (["cam1_009.png", "cam1_010.png"], ["cam2_009.png", "cam2_010.png"]),  # camera first
        (["9__14-57-01~73_1.jpg", "10__14-57-01~76_1.jpg"], ["9__14-57-01~73_2.jpg", "10__14-57-01~76_2.jpg"]),
    ],
)
def test_pictures_are_paired_by_their_common_number(left, right):
    pairs, leftover = pair_by_number([[Path(name) for name in left], [Path(name) for name in reversed(right)]])
    assert [(number, [path.name for path in paths]) for number, paths in pairs] == [
        (9, [left[0], right[0]]),
        (10, [left[1], right[1]]),
    ]
    assert leftover == []


def test_pictures_without_partner_are_left_over():
    left = [Path(f"{n}_1.jpg") for n in (1, 2, 3, 5)]
    right = [Path(f"{n}_2.jpg") for n in (1, 3, 4, 5)]
    pairs, leftover = pair_by_number([left, right])
    assert [number for number, _ in pairs] == [1, 3, 5]
    assert {path.name for path in leftover} == {"2_1.jpg", "4_2.jpg"}


def test_names_without_numbers_are_paired_in_order_or_refused():
    pairs, _ = pair_by_number([[Path("a.png"), Path("b.png")], [Path("c.png"), Path("d.png")]])
    assert [paths[1].name for _, paths in pairs] == ["c.png", "d.png"]
    with pytest.raises(CaptureError, match="2 and 1 pictures"):
        pair_by_number([[Path("a.png"), Path("b.png")], [Path("c.png")]])


def test_source_takes_numbers_and_times_from_names(tmp_path):
    write(tmp_path, "7__10-00-59~90_1.png", "8__10-01-00~00_1.png", "9__10-01-00~10_1.png")
    write(tmp_path, "7__10-00-59~90_2.png", "8__10-01-00~00_2.png", "9__10-01-00~10_2.png", "11__10-01-00~30_2.png")
    source = ImageFileSource([f"{tmp_path}/*_1.png", f"{tmp_path}/*_2.png"])
    sets = list(source)
    assert [s.number for s in sets] == [7, 8, 9] and source.frames == 3
    np.testing.assert_allclose([s.times_s[0] for s in sets], [0.0, 0.1, 0.2], atol=1e-6)
    assert source.fps == pytest.approx(10.0)
    assert "11__10-01-00~30_2.png" in source.warnings[0]
    assert [images[0][0, 0, 0] for images in source.samples(2)] == [0, 20]


def test_missing_numbers_count_as_time_without_times_in_names(tmp_path):
    write(tmp_path / "l", "1.png", "2.png", "5.png")
    write(tmp_path / "r", "1.png", "2.png", "5.png")
    sets = list(ImageFileSource([tmp_path / "l", tmp_path / "r"], fps=50.0))
    np.testing.assert_allclose([s.times_s[1] for s in sets], [0.0, 0.02, 0.08])


def test_unreadable_picture_is_named(tmp_path):
    write(tmp_path / "l", "1.png", "2.png")
    write(tmp_path / "r", "1.png", "2.png")
    (tmp_path / "r" / "2.png").write_bytes(b"\x89PNG broken")
    with pytest.raises(CaptureError, match=r"2\.png.*not a readable image"):
        list(ImageFileSource([tmp_path / "l", tmp_path / "r"]))


def test_image_sets_need_colour_images_with_a_time_each():
    picture = np.zeros((4, 6, 3), np.uint8)
    with pytest.raises(CaptureError, match="2 images, but 1 time stamp; give one"):
        ImageSet(0, (0.0,), (picture, picture))
    with pytest.raises(CaptureError, match="8-bit colour"):
        ImageSet(0, (0.0,), (picture[..., 0],))


def test_moment_missing_in_one_of_three_cameras_keeps_its_number():
    seen = ((1, 2, 3), (2, 3, 4), (1, 3, 4))
    lists = [[Path(f"{side}_{n:02d}.png") for n in numbers] for side, numbers in zip("abc", seen, strict=True)]
    tables = by_number(lists)
    assert [sorted(table) for table in tables] == [list(numbers) for numbers in seen]
    pairs, leftover = pair_by_number(lists)
    assert [number for number, _ in pairs] == [3] and len(leftover) == 6

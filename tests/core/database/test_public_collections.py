"""Collections of motion from the network, and the database made of one."""

import io
import struct
import tarfile
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from file_site import motion_archive, serving
from perfanim.core.cli.main import main
from perfanim.core.database import public_collections as public_collections_module
from perfanim.core.database.public_collections import file_name, get_collection, public_collections
from perfanim.core.database.store import open_database
from perfanim.core.errors import DownloadError, FormatError, PerfanimError, SettingsError
from perfanim.core.system.files import write_toml
from perfanim.core.system.progress import no_progress


@pytest.fixture
def site(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """Address and folder of a file server."""
    folder = tmp_path / "site"
    folder.mkdir()
    with serving(folder) as address:
        yield address, folder


def test_the_list_tells_what_one_may_do_with_each() -> None:
    for name, each in public_collections().items():
        assert name == each.name
        assert each.title and each.licence and each.good_for
        assert each.address.startswith(("http://", "https://")) and each.page.startswith(("http://", "https://"))
        assert 1 <= each.megabytes <= 100_000
        assert file_name(each.address, name) == f"{name}.zip"


def test_an_archive_becomes_a_database(site: tuple[str, Path], tmp_path: Path) -> None:
    address, folder = site
    motion_archive(folder / "walks.zip")
    arguments = [
        "database",
        "get",
        f"{address}/walks.zip",
        "--to",
        str(tmp_path / "got"),
        "--out",
        str(tmp_path / "a.pfdb"),
    ]
    assert main(arguments) == 0
    assert len(open_database(tmp_path / "a.pfdb").clips) == 2
    assert [path.name for path in (tmp_path / "got").iterdir()] == ["walks.zip"]
    (folder / "walks.zip").unlink()
    assert main(arguments) == 0  # it need not come again


def test_a_damaged_archive_is_told_and_not_kept(site: tuple[str, Path], tmp_path: Path) -> None:
    address, folder = site
    content = bytearray(motion_archive(folder / "walks.zip").read_bytes())
    content[len(content) // 3] ^= 0xFF
    (folder / "walks.zip").write_bytes(content)
    with pytest.raises(DownloadError, match=r"is damaged .*download it again"):
        get_collection(f"{address}/walks.zip", tmp_path / "got", no_progress)
    assert list((tmp_path / "got").iterdir()) == []


@pytest.mark.parametrize("name", ["walks.tar", "walks.tar.gz", "walks.tgz"])
def test_a_tar_archive_becomes_a_database_too(site: tuple[str, Path], tmp_path: Path, name: str) -> None:
    address, folder = site
    motion_archive(folder / name)
    out = tmp_path / "a.pfdb"
    assert main(["database", "get", f"{address}/{name}", "--to", str(tmp_path / "got"), "--out", str(out)]) == 0
    assert len(open_database(out).clips) == 2


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        *((name, damage) for name in ("walks.tar", "walks.tar.gz") for damage in ("cut", "turned", "another kind")),
        ("walks.tgz", "checksum"),  # a .tar has none of its files' bytes
    ],
)
def test_a_damaged_tar_archive_is_told_and_not_kept(
    site: tuple[str, Path], tmp_path: Path, name: str, damage: str
) -> None:
    address, folder = site
    content = bytearray(motion_archive(folder / name).read_bytes())
    if damage == "cut":
        del content[len(content) // 3 :]
    elif damage == "turned":
        content[100 if name.endswith(".tar") else len(content) // 3] ^= 0xFF
    elif damage == "another kind":
        content[:] = b"<html>not found</html>" * 100
    else:
        content[-6] ^= 0x01
    (folder / name).write_bytes(content)
    with pytest.raises(DownloadError, match=r"is damaged .*download it again"):
        get_collection(f"{address}/{name}", tmp_path / "got", no_progress)
    assert list((tmp_path / "got").iterdir()) == []


def packed(path: Path, name: str, size: int = 1000) -> None:
    """Write an archive with one file of zeros under any name."""
    if path.suffix == ".zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as opened:
            opened.writestr(name, bytes(size))
        return
    member = tarfile.TarInfo(name)
    member.size = size
    with tarfile.open(path, "w:gz") as archive:
        archive.addfile(member, io.BytesIO(bytes(size)))


@pytest.mark.parametrize("kind", ["zip", "tgz"])
@pytest.mark.parametrize("inside", ["../evil.bvh", "/etc/evil.bvh", "a/../../evil.bvh", "..\\evil.bvh", "C:\\evil.bvh"])
def test_an_archive_with_files_outside_its_folder_is_refused(
    site: tuple[str, Path], tmp_path: Path, kind: str, inside: str
) -> None:
    address, folder = site
    packed(folder / f"a.{kind}", inside)
    with pytest.raises(DownloadError, match="would be unpacked outside its folder"):
        get_collection(f"{address}/a.{kind}", tmp_path / "got", no_progress)
    assert list((tmp_path / "got").iterdir()) == []
    assert not list(tmp_path.rglob("evil*"))


@pytest.mark.parametrize("kind", ["zip", "tgz"])
def test_an_archive_that_holds_far_more_than_its_size_is_refused(
    site: tuple[str, Path], tmp_path: Path, kind: str
) -> None:
    address, folder = site
    packed(folder / f"a.{kind}", "a.bvh", 200_000_000)
    with pytest.raises(FormatError, match="far more than its size"):
        get_collection(f"{address}/a.{kind}", tmp_path / "got", no_progress)
    assert list((tmp_path / "got").iterdir()) == []


def _endless_name(path: Path) -> None:
    with tarfile.open(path, "w:gz", format=tarfile.GNU_FORMAT) as archive:
        archive.addfile(tarfile.TarInfo("x" * 50_000_000 + ".bvh"))


def _many_empty(path: Path) -> None:
    with tarfile.open(path, "w:gz") as archive:
        for number in range(4000):
            archive.addfile(tarfile.TarInfo(f"{number}.bvh"))


def _long_list(path: Path) -> None:
    listed = (b"PK\x01\x02" + bytes(24) + b"\x01" + bytes(17) + b"a") * 50_000
    path.write_bytes(listed + b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(listed), 0, 0))


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("a.tar.gz", _endless_name, r"is damaged \(a file name has 50000005 bytes\)"),
        ("a.tar.gz", _many_empty, "holds far more files than its size allows"),
        ("a.zip", _long_list, "holds far more files than its size allows"),
    ],
)
def test_names_and_lists_without_end_take_no_memory(
    site: tuple[str, Path], tmp_path: Path, name: str, write: Callable[[Path], None], message: str
) -> None:
    address, folder = site
    write(folder / name)
    tracemalloc.start()
    with pytest.raises(PerfanimError, match=message):
        get_collection(f"{address}/{name}", tmp_path / "got", no_progress)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 10 << 20
    assert list((tmp_path / "got").iterdir()) == []


def test_a_stopped_download_keeps_what_came_and_nothing_else(tmp_path: Path) -> None:
    folder, got = tmp_path / "site", tmp_path / "got"
    folder.mkdir()
    (folder / "walks.tar").write_bytes(bytes(500_000))

    def stop(fraction: float, _text: str) -> None:
        if fraction > 0.2:
            raise KeyboardInterrupt

    with serving(folder, pause_s=0.01) as address:
        with pytest.raises(KeyboardInterrupt):
            get_collection(f"{address}/walks.tar", got, stop)
        assert {path.name for path in got.iterdir()} == {".walks.tar.part", ".walks.tar.part.json"}
        assert 100_000 <= (got / ".walks.tar.part").stat().st_size < 500_000
        motion_archive(folder / "walks.tar")
        assert get_collection(f"{address}/walks.tar", got, no_progress) == got / "walks.tar"
    assert [path.name for path in got.iterdir()] == ["walks.tar"]
    assert (got / "walks.tar").read_bytes() == (folder / "walks.tar").read_bytes()


@pytest.mark.parametrize(
    ("last", "name"),
    [
        ("walks.zip", "walks.zip"),
        ("%2e%2e%2f%2e%2e%2fevil.zip", "evil.zip"),
        ("..%5Cevil.tar.gz", "evil.tar.gz"),
        (".zip", "motion.zip"),
        ("a%00b.tgz?x=/../y", "a-b.tgz"),
        ("x" * 300 + ".zip", "x" * 80 + ".zip"),
        ("-rf.ZIP", "rf.zip"),
    ],
)
def test_names_of_files_hold_no_paths(last: str, name: str) -> None:
    assert file_name(f"http://example.org/a/{last}") == name


def test_what_is_no_collection_is_told_before_anything_is_asked(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="no collection 'cmux'; give one of cmu"):
        get_collection("cmux", tmp_path, no_progress)
    with pytest.raises(DownloadError, match="not the address of a motion archive"):
        get_collection("http://127.0.0.1:9/page.html", tmp_path, no_progress)
    assert main(["database", "get", "cmu", "--fps", "0", "--to", str(tmp_path)]) == 1
    assert list(tmp_path.iterdir()) == []


def test_the_list_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["database", "get"]) == 0
    assert "CMU Graphics Lab" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"megabytes": "many"}, "collections.toml, walks: megabytes must be a whole number from 1 to 1,000,000 MB"),
        ({"address": None}, "collections.toml, walks: lacks 'address', a non-empty string"),
    ],
)
def test_a_list_that_does_not_fit_is_refused(tmp_path, monkeypatch, change, message) -> None:
    row = {"title": "a", "page": "b", "address": "c", "megabytes": 3, "licence": "d", "good_for": "e", "more": 1}
    path = tmp_path / "collections.toml"
    monkeypatch.setattr(public_collections_module, "COLLECTIONS", path)
    write_toml(path, {"walks": {key: value for key, value in (row | change).items() if value is not None}})
    with pytest.raises(FormatError, match=message):
        public_collections.__wrapped__()
    write_toml(path, {"walks": row})
    assert public_collections.__wrapped__()["walks"].megabytes == 3

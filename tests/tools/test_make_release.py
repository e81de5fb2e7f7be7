"""A release: one version, notes from the changelog, checksums and sizes of the archives."""

import hashlib
import zipfile

import build_extension
import make_release
import pytest
from perfanim.core import __version__

CHANGELOG = (make_release.ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_one_version_everywhere():
    make_release.check_version()
    assert 'dynamic = ["version"]' in (make_release.ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_another_version_in_the_manifest_is_refused(monkeypatch):
    monkeypatch.setattr(make_release, "__version__", "9.9.9")
    with pytest.raises(ValueError, match=r"9\.9\.9"):
        make_release.check_version()


def test_notes_are_the_section_of_the_version():
    text = "# Changelog\n\n## 1.1.0 (soon)\n\n- new\n\n## 1.0.0\n\n- old\n"
    assert make_release.release_notes(text, "1.1.0") == "- new\n"
    assert make_release.release_notes(text, "1.0.0") == "- old\n"
    assert "## " not in make_release.release_notes(CHANGELOG, __version__)


@pytest.mark.parametrize("text", ["", "## 1.0.00\n- x\n", "## 1.0.0\n\n## 0.9.0\n- x\n"])
def test_a_version_without_notes_is_refused(text):
    with pytest.raises(ValueError, match=r"no section 1\.0\.0"):
        make_release.release_notes(text, "1.0.0")


@pytest.fixture
def few_archives(monkeypatch):
    """One platform, with wheels that hold nothing."""

    def download(platform, folder):
        folder.mkdir(parents=True, exist_ok=True)
        wheel = folder / "python_osc-1.10.2-py3-none-any.whl"
        wheel.write_bytes(b"w" * 5000)
        return [wheel]

    monkeypatch.setattr(make_release, "PLATFORMS", {"linux-x64": build_extension.PLATFORMS["linux-x64"]})
    monkeypatch.setattr(make_release, "download_wheels", download)


def test_checksums_notes_and_sizes(few_archives, tmp_path):
    (tmp_path / "perfanim-0.0.1-linux-x64.zip").write_bytes(b"of an earlier release")
    archives = make_release.make_release(tmp_path, tmp_path / "wheels")
    assert [archive.name for archive in archives] == [f"perfanim-{__version__}-linux-x64.zip"]
    assert sorted(tmp_path.glob("*.zip")) == sorted(archives)
    lines = (tmp_path / make_release.CHECKSUMS).read_text().splitlines()
    assert lines == [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}" for path in archives]
    assert (tmp_path / make_release.NOTES).read_text() == make_release.release_notes(CHANGELOG, __version__)
    sizes = make_release.sizes(archives[0])
    assert sizes["wheels/python_osc-1.10.2-py3-none-any.whl"] == 5000  # stored as it is
    with zipfile.ZipFile(archives[0]) as archive:
        names = archive.namelist()
        assert sum(sizes.values()) == sum(entry.compress_size for entry in archive.infolist())
    assert not [
        name for name in names if name.startswith(("tests/", "tools/", "docs/", ".", "CHANGELOG", "CONTRIBUTING"))
    ]
    assert "core/vision" in make_release.size_table(archives[0])


def test_nothing_is_touched_without_notes(few_archives, tmp_path, monkeypatch):
    old = tmp_path / "perfanim-0.0.1-linux-x64.zip"
    old.write_bytes(b"of an earlier release")
    monkeypatch.setattr(make_release, "release_notes", lambda *_: (_ for _ in ()).throw(ValueError("no section")))
    with pytest.raises(ValueError, match="no section"):
        make_release.make_release(tmp_path, tmp_path / "wheels")
    assert old.exists()

"""What any button has: F1 opens its page of the manual, and undo names it as the panel does."""

import time
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from desktop import PATIENCE_S, BlenderWindow, Desktop
from pointing import Hand


@pytest.fixture
def opened_by_browser(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file that gets the addresses which Blender opens in the browser; made before Blender starts."""
    opened, browser = tmp_path / "opened", tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" >>{opened}\n')
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    return opened


def test_f1_opens_the_page_and_undo_has_the_names_of_the_buttons(
    opened_by_browser: Path, desktop: Desktop, window: BlenderWindow
) -> None:
    window.open_tab("Perfanim")
    hand = Hand(desktop, window, "help")
    for word, page, heading in (
        ("Start Capture", "capture-in-blender.html", "capture"),
        ("Add Character", "capture-in-blender.html", "character"),
    ):
        if word == "Add Character":
            hand.toggle("Capture")
            hand.toggle("Character")
        asked = hand.find(word, sidebar=True)
        desktop.move(asked.x, asked.y)
        time.sleep(0.5)
        desktop.key("F1")
        address = urlsplit(_next_line(opened_by_browser))
        path = Path(unquote(address.path))
        assert (address.scheme, path.name, address.fragment) == ("file", page, heading)
        assert f'id="{heading}"' in path.read_text()
        opened_by_browser.unlink()
    hand.click("Add Character", sidebar=True)
    window.wait(lambda s: s["armature"], "a character")
    hand.menu("Edit", "Undo History")
    hand.find("Add Character", sidebar=False)  # or it fails
    desktop.screenshot("help-undo-history")
    hand.escape()
    hand.away()
    desktop.key("ctrl+z")
    window.wait(lambda s: not s["armature"], "no character")


def _next_line(file: Path) -> str:
    limit = time.monotonic() + PATIENCE_S
    while not (file.exists() and file.read_text().endswith("\n")):
        assert time.monotonic() < limit, "no address was opened"
        time.sleep(0.2)
    return file.read_text().splitlines()[0]

"""Finds words on the screen, as a person does, and clicks on them.

Blender draws the word by its own font, and that picture is looked for on a screenshot.
"""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from desktop import DRAWING_S, BlenderWindow, Desktop

LIKE = 0.85  # correlation from which a place is taken for the word
AS_LIKE = 0.03  # less than the best place's, up to which another one is the same word again
INK = 40  # grey level from which a pixel belongs to a letter
SAME_PX = 6
MOVED = 0.003  # of the sidebar's pixels change where a panel opens or closes: an empty one changes 0.006, none at all 0
TRIES = 4
OPENED_S = 10.0  # in which a busy machine has opened a menu
BESIDE_PX, CLEAR_PX, HALF_ROW_PX = 6, 80, 10  # the free part of a heading: from its word, width, half its height
_EDGE_PX = 4  # from the sidebar's edge: beside the lists, which would scroll themselves
PATH_PX = 510  # from the word Bookmarks in the file browser to the middle of the path
LIST_PX = 300  # from there down into the list of files


@dataclass(frozen=True)
class Place:
    """Centre of a word on the screen, and how much it is like it."""

    x: float
    y: float
    likeness: float


class Hand:
    """Looks for words in a Blender window, clicks and types.

    Args:
        desktop: the screen.
        window: what is on it.
        name: begins the names of the screenshots.
    """

    def __init__(self, desktop: Desktop, window: BlenderWindow, name: str) -> None:
        self._desktop = desktop
        self._window = window
        self._name = name
        self._words: dict[str, np.ndarray] = {}
        self._shots = 0

    def shot(self, step: str) -> Path:
        """Keep a picture of the screen, without the pointer over a button."""
        self.away()
        self._desktop.wait_until_calm()
        self._shots += 1
        return self._desktop.screenshot(f"{self._name}-{self._shots:02d}-{step}")

    def away(self) -> None:
        """Move the pointer over the 3D view, which then gets the keys."""
        view = self._window.state()["regions"]["WINDOW"]
        self._desktop.move(*self._window.from_top(view, view[2] * 0.2, view[3] * 0.75))
        time.sleep(0.4)

    def scroll_to_the_end(self) -> None:
        """Scroll the sidebar down to its end."""
        region = self._window.state()["regions"]["UI"]
        self._desktop.move(*self._window.from_top(region, _EDGE_PX, region[3] * 0.5))
        self._desktop.run("xdotool", "click", "--repeat", "30", "--delay", "30", "5")

    def menu(self, *words: str) -> None:
        """Click on the entries of a menu, one after the other; again where a busy machine has lost the click."""
        for word, following in zip(words, (*words[1:], ""), strict=True):
            for _ in range(TRIES):
                self.click(word, sidebar=False)
                if not following or self._comes(following):
                    break

    def click(self, word: str, sidebar: bool | None = None, beside: float = 0.0, lowest: bool = False) -> None:
        """Click on a word, or so many pixels to its right."""
        place = self.find(word, sidebar, lowest)
        self._desktop.click(place.x + beside, place.y)
        time.sleep(0.3)

    def toggle(self, panel: str) -> None:
        """Open or close a panel by its header, again where a busy machine has lost the click."""
        for _ in range(TRIES):
            before = self._sidebar()
            self.click(panel, sidebar=True)
            limit = time.monotonic() + DRAWING_S
            while time.monotonic() < limit:
                if (np.abs(self._sidebar() - before) > INK).mean() > MOVED:
                    return
                time.sleep(0.3)
        raise AssertionError(f"{panel!r} does not open or close: {self.shot('not-toggled')}")

    def type_over(
        self, word: str, text: str, beside: float = 0.0, sidebar: bool | None = None, below: float = 0.0
    ) -> None:
        """Put a text in place of what a field shows: the word, or what is so many pixels right of and below it."""
        place = self.find(word, sidebar)
        self._twice(replace(place, x=place.x + beside, y=place.y + below))
        self._desktop.key("ctrl+a")
        self._desktop.run("xdotool", "type", "--delay", "30", text)
        self._desktop.key("Return")

    def escape(self) -> None:
        """Close a menu that has been opened by mistake."""
        self._desktop.key("Escape")
        time.sleep(0.4)

    def choose_file(self, path: Path) -> None:
        """Go to the file's folder in the file browser, and open the file there with two clicks."""
        self._go_to(path.parent)
        for _ in range(TRIES):
            self._twice(self.find(path.name))
            limit = time.monotonic() + 2.0 * DRAWING_S  # a busy machine may take two clicks for two single ones
            while time.monotonic() < limit:
                if not self._window.state()["browser"]:
                    return
                time.sleep(0.3)
        raise AssertionError(f"{path} is not opened: {self.shot('not-opened')}")

    def save_in(self, folder: Path) -> None:
        """Go to a folder in the file browser and save there under the name that is offered."""
        self._go_to(folder)
        place = self.find("Bookmarks")
        self._desktop.move(place.x + PATH_PX, place.y + LIST_PX)  # a button under the pointer, as Cancel, takes the key
        self._desktop.key("Return")
        self._wait_for_no_browser()

    def find(self, word: str, sidebar: bool | None = None, lowest: bool = False) -> Place:
        """Return the place of a word that has stopped moving: the uppermost, or lowest, where there are several.

        Args:
            word: as Blender draws it.
            sidebar: where it is looked for: within the sidebar, outside of it, or (None) everywhere.
        """
        limit = time.monotonic() + DRAWING_S
        last: Place | None = None
        while True:
            places = [place for place in self._places(word) if sidebar in (None, self._in_sidebar(place))]
            if places:
                best = max(place.likeness for place in places)
                alike = [place for place in places if place.likeness > best - AS_LIKE]
                found = (max if lowest else min)(alike, key=lambda place: place.y)
                if last is not None and abs(found.x - last.x) + abs(found.y - last.y) < 2.0:
                    return found
                last = found
            if time.monotonic() > limit:
                raise AssertionError(f"{word!r} is not on {self.shot('not-found')}")
            time.sleep(0.2)

    def is_clear(self, heading: str, screen: np.ndarray) -> bool:
        """Return whether nothing lies over a heading of the sidebar, right of its word, on a picture of the screen."""
        place = next(place for place in self._places(heading, screen) if self._in_sidebar(place))
        x, y = round(place.x + self._drawn(heading).shape[1] / 2) + BESIDE_PX, round(place.y)
        row = screen[y - HALF_ROW_PX : y + HALF_ROW_PX, x : x + CLEAR_PX]
        return int(row.max()) - int(row.min()) < INK

    def _comes(self, word: str) -> bool:
        """Return whether a word is outside of the sidebar soon."""
        limit = time.monotonic() + OPENED_S
        while time.monotonic() < limit:
            if any(not self._in_sidebar(place) for place in self._places(word)):
                return True
            time.sleep(0.3)
        return False

    def _sidebar(self) -> np.ndarray:
        region = self._window.state()["regions"]["UI"]
        left, top = map(round, self._window.from_top(region, 0, 0))
        return self._desktop.seen()[top : top + region[3], left : left + region[2]].astype(np.int16)

    def _in_sidebar(self, place: Place) -> bool:
        region = self._window.state()["regions"]["UI"]
        left, top = self._window.from_top(region, 0, 0)
        return left <= place.x <= left + region[2] and top <= place.y <= top + region[3]

    def _places(self, word: str, screen: np.ndarray | None = None) -> list[Place]:
        template = self._drawn(word)
        picture = (self._desktop.seen() if screen is None else screen).max(axis=2)
        likeness = cv2.matchTemplate(picture, template, cv2.TM_CCOEFF_NORMED)
        found = []
        while likeness.max() >= LIKE:
            y, x = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
            centre = (float(x + template.shape[1] / 2), float(y + template.shape[0] / 2))
            found.append(Place(*centre, float(likeness[y, x])))
            likeness[max(0, y - SAME_PX) : y + SAME_PX + 1, max(0, x - SAME_PX) : x + SAME_PX + 1] = -1.0
        return found

    def _drawn(self, word: str) -> np.ndarray:
        """Return a picture of a word (height, width) as Blender draws it."""
        if word not in self._words:
            pixels = np.load(self._window.order("draw_text", text=word)["path"])
            rows, columns = (np.flatnonzero(pixels.max(axis=axis) > INK) for axis in (1, 0))
            self._words[word] = pixels[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        return self._words[word]

    def _twice(self, place: Place) -> None:
        self._desktop.move(place.x, place.y)
        time.sleep(0.3)
        self._desktop.run("xdotool", "click", "--repeat", "2", "--delay", "90", "1")
        time.sleep(0.4)

    def _go_to(self, folder: Path) -> None:
        here = self._window.wait(lambda s: s["browser"], "file browser")["browser"]
        wanted = f"{folder}/"
        if here != wanted:
            self.type_over("Bookmarks", wanted, beside=PATH_PX)  # the path itself is cut where it is long
            self._window.wait(lambda s: s["browser"] == wanted, "folder")

    def _wait_for_no_browser(self) -> None:
        self._window.wait(lambda s: not s["browser"], "end of the file browser")

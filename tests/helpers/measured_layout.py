"""A layout that measures: what a panel draws, how wide each text is in Blender's own font, and what it has room for."""

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import blf
import bpy

TEXT_PX = 11.0  # of Blender's interface at a scale of 1
SIDEBAR_PX = 280  # as Blender opens it
TABS_PX, MARGINS_PX = 26, 20  # beside and around a panel
CONTENT_PX = SIDEBAR_PX - TABS_PX - MARGINS_PX
ICON_PX, LABEL_PAD_PX, BUTTON_PAD_PX, ARROW_PX = 20.0, 4.0, 10.0, 14.0
BOX_PX = 10  # a frame and its margin, at both sides
NAMES_SHARE = 0.4  # of a property's width, for its name at the left

Problem = tuple[str, int, int]  # text, pixels that it needs and has


def text_px(text: str) -> float:
    """Width of a text."""
    blf.size(0, TEXT_PX)
    return float(blf.dimensions(0, text)[0])


class Layout:
    """Stands for `UILayout`: keeps what is drawn as a tree.

    Args:
        kind: "column", "row", "grid", "split" or "leaf".
    """

    def __init__(self, kind: str, parent: "Layout | None" = None, **facts: Any) -> None:
        self.kind, self.children, self.facts = kind, [], facts
        self.operator_context = ""
        self.use_property_split = parent.use_property_split if parent else False
        if parent is not None:
            parent.children.append(self)

    def _leaf(self, need_px: float, text: str) -> None:
        Layout("leaf", self, need_px=need_px, text=text)

    def column(self, **_: Any) -> "Layout":
        return Layout("column", self)

    def row(self, **_: Any) -> "Layout":
        return Layout("row", self)

    def box(self) -> "Layout":
        return Layout("column", self, less_px=BOX_PX)

    def split(self, factor: float = 0.5, **_: Any) -> "Layout":
        return Layout("split", self, factor=factor)

    def grid_flow(self, columns: int = 2, **_: Any) -> "Layout":
        return Layout("grid", self, columns=columns)

    def panel(self, _name: str, **_: Any) -> tuple["Layout", "Layout"]:
        return Layout("row", self, less_px=ICON_PX), Layout("column", self)

    def separator(self, **_: Any) -> None: ...

    def context_pointer_set(self, *_: Any) -> None: ...

    def template_list(self, *_: Any, **__: Any) -> None: ...

    def template_icon_view(self, *_: Any, **__: Any) -> None: ...

    def label(self, text: str = "", icon: str = "NONE") -> None:
        self._leaf(text_px(text) + LABEL_PAD_PX + ICON_PX * (icon != "NONE"), text)

    def progress(self, text: str = "", **_: Any) -> None:
        self._leaf(0.0, text)  # of sentences of any length; Blender shortens them

    def operator(self, name: str, text: str | None = None, icon: str = "NONE", **_: Any) -> Any:
        group, operator = name.split(".")
        shown = getattr(getattr(bpy.ops, group), operator).get_rna_type().name if text is None else text
        self._button(shown, icon)
        return SimpleNamespace()

    def operator_menu_enum(self, name: str, _setting: str, **more: Any) -> Any:
        return self.operator(name, **more)

    def menu(self, _name: str, text: str = "", icon: str = "NONE") -> None:
        self._button(text, icon)

    def _button(self, text: str, icon: str) -> None:
        self._leaf(text_px(text) + BUTTON_PAD_PX * bool(text) + ICON_PX * (icon != "NONE"), text)

    def prop_search(self, *_: Any, **__: Any) -> None:
        self._leaf(ICON_PX, "")

    def prop_enum(self, owner: Any, name: str, value: str) -> None:
        self._button(owner.bl_rna.properties[name].enum_items[value].name, "NONE")

    def prop(self, owner: Any, name: str, text: str | None = None, expand: bool = False, **_: Any) -> None:
        known = owner.bl_rna.properties[name]
        shown = known.name if text is None else text
        items = [item.name for item in known.enum_items_static] if known.type == "ENUM" else []
        if expand:
            self._leaf(sum(text_px(item) + BUTTON_PAD_PX for item in items), ", ".join(items))
        elif not shown:
            self._leaf(2 * ICON_PX, "")
        elif not self.use_property_split:
            self._leaf(text_px(shown) + BUTTON_PAD_PX + ICON_PX, shown)
        elif known.type == "BOOLEAN":  # the name is beside the box
            self._leaf((text_px(shown) + ICON_PX) / (1.0 - NAMES_SHARE), shown)
        else:
            longest = max((text_px(item) for item in items), default=0.0) + BUTTON_PAD_PX + ARROW_PX
            name_px = (text_px(shown) + LABEL_PAD_PX) / NAMES_SHARE
            self._leaf(max(name_px, longest / (1.0 - NAMES_SHARE)), f"{shown}: {max(items, key=text_px, default='')}")

    def texts(self) -> list[str]:
        """Return all texts, from the top down."""
        return [self.facts.get("text") or "", *(text for child in self.children for text in child.texts())]

    def problems(self, width_px: float) -> Iterator[Problem]:
        """Yield the texts that are cut off in this width."""
        width_px -= self.facts.get("less_px", 0)
        if self.kind == "leaf":
            if self.facts["need_px"] > width_px:
                yield self.facts["text"], round(self.facts["need_px"]), round(width_px)
        elif self.kind == "row":
            need_px = sum(child.need_px() for child in self.children)
            if need_px > width_px:  # all shrink
                yield " | ".join(filter(None, self.texts())), round(need_px), round(width_px)
        else:
            for number, child in enumerate(self.children):
                yield from child.problems(width_px * self._share(number))

    def _share(self, number: int) -> float:
        if self.kind == "grid":
            return 1.0 / self.facts["columns"]
        if self.kind == "split":
            factor = self.facts["factor"]
            return factor if number == 0 else (1.0 - factor) / max(len(self.children) - 1, 1)
        return 1.0

    def need_px(self) -> float:
        """Width that all texts need."""
        if self.kind == "leaf":
            return float(self.facts["need_px"])
        needs = [child.need_px() / self._share(number) for number, child in enumerate(self.children)]
        total = sum(needs) if self.kind == "row" else max(needs, default=0.0)
        return float(total + self.facts.get("less_px", 0))


def stand_in(panel: type, layout: Layout) -> Any:
    """Return what stands for a panel that is drawn into a layout; Blender's own classes cannot be made."""
    own = [base for base in reversed(panel.__mro__) if "perfanim" in base.__module__]
    members = {name: value for base in own for name, value in vars(base).items() if name[:2] != "__" != name[-2:]}
    shown = type(panel.__name__, (), {**members, "bl_rna": None})()
    shown.layout = layout
    return shown


class Context:
    """Stands for the context of a sidebar of the default width."""

    def __init__(self) -> None:
        self.region = SimpleNamespace(width=SIDEBAR_PX, as_pointer=lambda: 1)
        addons = bpy.context.preferences.addons
        self.preferences = SimpleNamespace(system=SimpleNamespace(ui_scale=1.0), addons=addons)  # no window has a scale

    def __getattr__(self, name: str) -> Any:
        return getattr(bpy.context, name)


def cut_off(draw: Callable[[Any, Any], None], panel: type, width_px: float = CONTENT_PX) -> list[Problem]:
    """Return the texts of a panel that are cut off in a sidebar of the default width."""
    layout = Layout("column")
    draw(stand_in(panel, layout), Context())
    return list(layout.problems(width_px))

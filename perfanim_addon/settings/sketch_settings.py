"""Settings for a character's sketch, stored with its armature object."""

from typing import Any

import bpy

from ...core.sketch.solve_sketch import SketchSettings
from ..preferences.property_kinds import (
    choice,
    draw_props,
    number,
    pointer,
    property_column,
    string,
    switch,
    whole_number,
)

CONTROLS = {
    "HANDS": ("lhand", "rhand"),
    "FEET": ("lfoot", "rfoot"),
    "HIPS": ("root",),
    "CHEST": ("thorax",),
    "HEAD": ("head",),
}


class PERFANIM_PG_sketch(bpy.types.PropertyGroup):
    """Settings of the Sketch Motion panel, and the controls and action of the sketch."""

    attached_to = (bpy.types.Object, "perfanim_sketch")
    parts: choice(
        "Controls",
        "Controls to add, Shift-click for several. Joints without a control are free",
        tuple((key, key.title(), f"Add controls: {key.lower()}", 1 << bit) for bit, key in enumerate(CONTROLS)),
        default={"FEET", "HIPS"},
        options={"ENUM_FLAG"},
    )
    follow: number(
        "Follow",
        "Between the keys: 0 keeps the database's motion, 1 follows the curves. Keys are met either way",
        0.3,
        0.0,
        1.0,
        subtype="FACTOR",
    )
    behaviours: string("Behaviours", "Beginnings of the behaviours to draw from, separated by commas; empty for all")
    variation: whole_number("Variation", "0 for the best explanation, 1 for the next best, and so on", 0, 0, 20)
    hold_feet: switch("Hold Feet", "Keep standing feet in place", default=True)
    free_height: switch(
        "Free Height", "Keys and path of the hips bind only as seen from above; the height comes from the database"
    )
    controls: pointer("Collection", "Collection of the sketch's controls", bpy.types.Collection)
    action: pointer("Result", "Action with the solved motion", bpy.types.Action)
    rough: pointer("Rough Action", "Action that From Animation reads the keys from", bpy.types.Action)

    @property
    def chosen_joints(self) -> list[str]:
        """Joints of the chosen controls."""
        return [joint for key, joints in CONTROLS.items() if key in self.parts for joint in joints]

    @property
    def chosen_behaviours(self) -> list[str]:
        """Beginnings of the names of the chosen behaviours; empty for all."""
        return [name.strip() for name in self.behaviours.split(",") if name.strip()]

    def solver_settings(self) -> SketchSettings:
        """Return the settings of the solver."""
        names = tuple(f"{name}*" for name in self.chosen_behaviours)
        return SketchSettings(self.follow, names, self.variation, self.hold_feet)

    def take_over(self, chosen: SketchSettings) -> None:
        """Copy the settings of a stored sketch into the panel."""
        self.follow, self.variation, self.hold_feet = chosen.follow, chosen.variation, chosen.hold_feet
        self.behaviours = ", ".join(name.removesuffix("*") for name in chosen.behaviours)


def draw(layout: bpy.types.UILayout, chosen: Any) -> None:
    """Draw the settings of the solver."""
    column = property_column(layout)
    draw_props(column, chosen, "follow")
    split = column.split(factor=0.4)
    label = split.row()
    label.alignment = "RIGHT"
    label.label(text="Behaviours")
    listed = split.column(align=True)
    for name in chosen.chosen_behaviours:
        listed.operator("perfanim.remove_behaviour", text=name, icon="X").behaviour = name
    listed.operator("perfanim.add_behaviour", text="Add" if chosen.behaviours else "All", icon="ADD")
    draw_props(column, chosen, "variation", "hold_feet", "free_height")

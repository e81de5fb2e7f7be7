"""Settings of a character's sketch, stored with its armature object."""

from typing import Any

import bpy

from ...core.sketch.solve_sketch import SketchSettings
from ..preferences.attach_settings import attach_property_group
from ..preferences.property_kinds import choice, draw_props, number, property_column, string, switch, whole_number

CONTROLS = {
    "HANDS": ("lhand", "rhand"),
    "FEET": ("lfoot", "rfoot"),
    "HIPS": ("root",),
    "CHEST": ("thorax",),
    "HEAD": ("head",),
}


class PERFANIM_PG_sketch(bpy.types.PropertyGroup):
    """Settings of the Sketch Motion panel, and the sketch's controls and action."""

    parts: choice(
        "Controls",
        "Controls to add, Shift-click for several. What has no control is free",
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
    behaviours: string(
        "Behaviours", "Draw only from clips of these, separated by commas, such as walking, boxing; empty for all"
    )
    variation: whole_number("Variation", "0 for the best explanation, 1 for the next best, and so on", 0, 0, 20)
    hold_feet: switch("Hold Feet", "Keep standing feet in place", default=True)
    free_height: switch(
        "Free Height", "Keys and path of the hips bind as seen from above; the database has their height"
    )
    controls: bpy.props.PointerProperty(
        name="Collection", description="Collection of the sketch's controls", type=bpy.types.Collection
    )
    action: bpy.props.PointerProperty(name="Result", description="Action with the solved motion", type=bpy.types.Action)
    rough: bpy.props.PointerProperty(
        name="Rough Action", description="Action that From Animation reads the keys from", type=bpy.types.Action
    )

    @property
    def chosen_joints(self) -> list[str]:
        """Joints of the chosen controls."""
        return [joint for key, joints in CONTROLS.items() if key in self.parts for joint in joints]

    def solver_settings(self) -> SketchSettings:
        """Return the settings as the solver takes them."""
        names = tuple(f"{name.strip()}*" for name in self.behaviours.split(",") if name.strip())
        return SketchSettings(self.follow, names, self.variation, self.hold_feet)

    def take_over(self, chosen: SketchSettings) -> None:
        """Set the settings of a stored sketch."""
        self.follow, self.variation, self.hold_feet = chosen.follow, chosen.variation, chosen.hold_feet
        self.behaviours = ", ".join(name.removesuffix("*") for name in chosen.behaviours)


def draw(layout: bpy.types.UILayout, chosen: Any) -> None:
    """Draw the settings of the solver."""
    draw_props(property_column(layout), chosen, "follow", "behaviours", "variation", "hold_feet", "free_height")


register, unregister = attach_property_group(bpy.types.Object, "perfanim_sketch", PERFANIM_PG_sketch)

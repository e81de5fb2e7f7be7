"""Random steps in a window, one an order, so that a capture goes on between them."""

import sys
from pathlib import Path

import bpy
from remains import remains

sys.path.append(str(Path(__file__).resolve().parents[2] / "tools"))

from operator_fuzz import addon_steps, sequence

running = {}


def order_fuzz_begin(order):
    """Begin a sequence; tell how many steps it has."""
    folder = Path(order["folder"])
    running["folder"] = folder
    if "before" not in running:
        _in_window(sequence.end)
        running["before"] = remains()
    _in_window(sequence.clear)
    _in_window(sequence.begin, folder)  # in the window that the file has brought
    chance, steps = sequence.steps_of(order["seed"], order["sequence"])
    running.update(chance=chance, steps=list(steps))
    return {"steps": len(steps)}


def order_fuzz_step(order):
    """Take the next step; a window ticks by itself."""
    step = running["steps"].pop(0)
    if step is addon_steps.tick:
        return {"line": "wait"}
    return {"line": _in_window(sequence.take_step, step, running["chance"], running["folder"])}


def order_fuzz_end(order):
    """End as another file and the add-on's switch do; tell what is left."""
    _in_window(sequence.end)
    return {"left": sequence.left_over(running["before"], running["folder"])}


def _in_window(function, *arguments):
    """Call as from a window: a timer has none."""
    window = bpy.context.window_manager.windows[0]
    area = next((area for area in window.screen.areas if area.type == "VIEW_3D"), window.screen.areas[0])
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        return function(*arguments)


ORDERS = {"fuzz_begin": order_fuzz_begin, "fuzz_step": order_fuzz_step, "fuzz_end": order_fuzz_end}

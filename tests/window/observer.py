"""Runs inside Blender: writes what it sees to a file, ten times a second, and follows a few orders.

It never clicks and never calls the add-on's operators unless a test orders it to.
"""

import json
import os
import sys
import traceback
from pathlib import Path

import bpy

sys.path.append(str(Path(__file__).resolve().parent))
sys.path.append(str(Path(__file__).resolve().parents[1] / "helpers"))

import observer_fuzz
import observer_orders
import observer_rates
import observer_state

FOLDER = Path(os.environ["OBSERVER_FOLDER"])

ticks = 0
orders = 0
answer = {}


def report():
    global ticks
    ticks += 1
    found = observer_state.regions()
    colour = bpy.context.preferences.themes[0].user_interface.wcol_tool.inner
    obj = observer_state.armature()
    state = {
        "ticks": ticks,
        "orders": orders,
        "answer": answer,
        "tab": found.pop("tab", ""),
        "regions": found,
        "browser": observer_state.browser(),
        "button_colour": [round(255 * c) for c in colour[:3]],
        "capture": observer_state.capture_facts(),
        "preview": observer_state.preview_facts(),
        "changes": len(observer_rates.changes),
        "pose": observer_rates.last_pose(),
        "armature": obj.name if obj else "",
        "actions": observer_state.actions(),
        "frame_end": bpy.context.scene.frame_end,
        "windows": len(bpy.context.window_manager.windows),
    }
    temporary = FOLDER / "state.new"
    temporary.write_text(json.dumps(state))
    temporary.replace(FOLDER / "state.json")


def follow_orders():
    global orders, answer
    try:
        order = json.loads((FOLDER / "order.json").read_text())
    except FileNotFoundError:
        return
    if order["number"] <= orders:
        return
    try:
        result = (observer_orders.ORDERS | observer_fuzz.ORDERS)[order["what"]](order)
    except Exception as error:  # the test reads it
        traceback.print_exc()
        result = {"error": f"{type(error).__name__}: {error}"}
    if result is not None:
        answer, orders = result, order["number"]


def every_tenth():
    try:
        follow_orders()
        report()
    except Exception:  # Blender never calls a timer again that has raised; the run would hang without a word
        traceback.print_exc()
    return 0.1


if "PERFANIM_KEEP_PICTURES" not in os.environ:
    # Without a graphics card the processors draw the viewport, again and again until its edges are smooth: a capture
    # has hardly any processor time left. No test looks at edges.
    bpy.context.preferences.system.viewport_aa = "OFF"
observer_rates.watch()
bpy.app.timers.register(every_tenth, persistent=True)

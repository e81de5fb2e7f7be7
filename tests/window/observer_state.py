"""What the observer reports of Blender: regions, the capture, the preview, actions."""

import sys

import bpy

ADDON = "bl_ext.user_default.perfanim"

last_run = None


def part(name):
    return sys.modules.get(f"{ADDON}.perfanim_addon.{name}")


def armature():
    return bpy.context.scene.perfanim.armature if hasattr(bpy.context.scene, "perfanim") else None


def regions():
    found = {}
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "VIEW_3D":
            for region in area.regions:
                found[region.type] = [region.x, region.y, region.width, region.height]
                if region.type == "UI":
                    found["tab"] = getattr(region, "active_panel_category", "")
    return found


def browser():
    """Return the folder that a file browser shows, "" without one."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            params = area.spaces.active.params if area.type == "FILE_BROWSER" else None
            if params is not None:
                return params.directory.decode()
    return ""


def capture_facts():
    running, capture = part("jobs.activity"), part("operators.capture_operators")
    if running is None or capture is None:
        return {"registered": False}
    messages = {panel: running.message(panel)[0] for panel in running._state.messages}
    facts = {"registered": True, "messages": messages, "activity": None, "heading": ""}
    facts["walk"] = part("settings.guide_steps").seen.walk
    activity = running.current()
    facts["timer"] = running._state.timer is not None
    if activity is not None:
        facts["activity"] = type(activity).__name__
        facts["line"] = getattr(activity, "text", "")
        facts["heading"] = getattr(activity, "heading", "")
        run = getattr(activity, "run", None)
        if run is not None:
            facts["phase"] = run.phase.name
            facts["recording"] = getattr(activity, "recording", None) is not None
            facts["line"] = run.activity
            facts["notices"] = run.notices
            facts["statistics"] = vars(run.statistics)
            remember(run)
    return facts


def preview_facts():
    preview = part("viewport.picture_overlay")
    if preview is None:
        return {}
    return {"shown": preview.handler.added, "image": preview.NAME in bpy.data.images}


def remember(run):
    global last_run
    last_run = run


def curves_in(action):
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    strips = [strip for layer in action.layers for strip in layer.strips]
    return [curve for strip in strips for bag in strip.channelbags for curve in bag.fcurves]


def actions():
    found = {}
    for action in bpy.data.actions:
        curves = curves_in(action)
        keys = [len(curve.keyframe_points) for curve in curves]
        found[action.name] = {
            "curves": len(curves),
            "paths": sorted({curve.data_path.rpartition(".")[2] for curve in curves}),
            "keys_min": min(keys, default=0),
            "keys_max": max(keys, default=0),
            "last": float(action.frame_range[1]),
            "groups": len({curve.group.name for curve in curves if curve.group}),
        }
    return found

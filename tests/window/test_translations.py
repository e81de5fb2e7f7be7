"""The sidebar in another language: only a Blender with a window has languages at all."""

import os
import subprocess
from pathlib import Path

IN_GERMAN = """
import bpy
view = bpy.context.preferences.view
view.language, view.use_translate_interface = "de_DE", True
text = bpy.app.translations.pgettext_iface
print("TEXT:", text("Motion Database"), text("Start Capture", "Operator"), text("Start Capture"), sep="|")
"""


def test_panels_and_buttons_are_translated(wrapper: str, user: Path) -> None:
    command = [wrapper, "blender", "--background", "--python-expr", IN_GERMAN]
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(user)}
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("TEXT:"))
    assert line == "TEXT:|Bewegungsdatenbank|Aufnahme starten|Start Capture"

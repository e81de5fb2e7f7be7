"""The words of the sidebar in other languages, for Blender's own switch (Preferences > Interface > Translation).

Blender looks up what it draws by its English text; what has no translation here stays English. A further language is a
further pair of tables, one for buttons and one for all else.
"""

import bpy

from .paths import ADDON

_GERMAN_WORDS = {
    "Cameras": "Kameras",
    "Exposure, Gain, Focus": "Belichtung, Verstärkung, Schärfe",
    "Markers": "Marker",
    "Subject": "Darsteller",
    "Motion Database": "Bewegungsdatenbank",
    "Character": "Figur",
    "Capture": "Aufnahme",
    "Takes": "Aufzeichnungen",
    "Batch": "Stapel",
    "Results": "Ergebnisse",
    "Joint Angles": "Gelenkwinkel",
    "Processes": "Prozesse",
    "Source": "Quelle",
    "Simulated Performer": "Simulierter Darsteller",
    "Image Folders": "Bildordner",
    "Performs": "Führt vor",
    "Practise Calibration": "Kalibrierung üben",
    "Calibration": "Kalibrierung",
    "Extend Scene": "Szene verlängern",
    "Preview": "Vorschau",
    "Send by VMC": "Mit VMC senden",
    "Host": "Rechner",
    "Smoothing (ms)": "Glättung (ms)",
    "Feet": "Füße",
    "Record by Button": "Auf Knopfdruck aufnehmen",
    "Countdown": "Vorlauf",
    "Stop After": "Beenden nach",
    "Board": "Tafel",
    "Height (mm)": "Höhe (mm)",
    "Farthest (mm)": "Größter Abstand (mm)",
    "Further Targets": "Weitere Ziele",
    "Further": "Weitere",
    "Kind": "Art",
    "Prop": "Requisit",
    "Performer": "Darsteller",
    "Only": "Nur",
    "Onto": "Auf",
    "Fewer Keys": "Weniger Keyframes",
    "Next Pose": "Nächste Pose",
    "Height (m)": "Größe (m)",
    "All Three Poses": "Alle drei Posen",
}
_GERMAN_BUTTONS = {
    "Start Capture": "Aufnahme starten",
    "Stop Capture": "Aufnahme beenden",
    "Record": "Aufnehmen",
    "Calibrate with Board": "Mit Tafel kalibrieren",
    "Set Floor from Board": "Boden nach Tafel setzen",
    "Set Floor from Markers": "Boden nach Markern setzen",
    "Board to Print": "Tafel zum Drucken",
    "Calibrate from Pictures": "Aus Bildern kalibrieren",
    "Calibrate Performer": "Darsteller kalibrieren",
    "Record T Pose": "T-Pose aufnehmen",
    "Import Motion": "Bewegung importieren",
    "Use Starter": "Mitgelieferte verwenden",
    "Add Character": "Figur hinzufügen",
    "Use Active Armature": "Aktive Armatur verwenden",
    "Find Bones": "Knochen suchen",
    "Use Active Bone": "Aktiven Knochen verwenden",
    "Add Target": "Ziel hinzufügen",
    "Remove Target": "Ziel entfernen",
    "Measure from Take": "Aus Aufzeichnung messen",
    "Recover Take": "Aufzeichnung retten",
    "Put on Character": "Auf Figur übertragen",
    "Solve Again": "Neu berechnen",
    "Delete Take": "Aufzeichnung löschen",
    "Restore": "Zurückholen",
    "Clean Up Takes": "Aufräumen",
    "Import Marker Takes": "Markeraufzeichnungen importieren",
    "Run Batch": "Stapel starten",
    "Export Take": "Aufzeichnung exportieren",
    "Self-Test": "Selbsttest",
    "Copy Diagnostics": "Diagnose kopieren",
}


def tables() -> dict[str, dict[tuple[str, str], str]]:
    """Return for each language the text that replaces an English one of a context, as Blender takes it."""
    words = {("*", text): german for text, german in _GERMAN_WORDS.items()}
    return {"de_DE": {**words, **{("Operator", text): german for text, german in _GERMAN_BUTTONS.items()}}}


def register() -> None:
    """Offer the tables to Blender."""
    bpy.app.translations.register(ADDON, tables())


def unregister() -> None:
    """Take them away."""
    bpy.app.translations.unregister(ADDON)

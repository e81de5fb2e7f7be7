"""Fuzz test of the add-on: random steps of a user in Blender.

    cd tools && python -m operator_fuzz --sequences 10000 --seed 1

Steps use buttons, settings, undo, files, deleting and modes, and switch the add-on off and on. Each sequence begins
with an empty scene. A step may only raise what a button reports, and after the last one nothing of the add-on may be
left: no process, timer, handler, class, image or temporary file. A number and a seed reproduce a sequence.

Blender as a module sometimes crashes in the step `undo` even without the add-on, because its view layer is gone. In a
window (`--window`) it does not.
"""

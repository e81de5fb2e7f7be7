"""Random steps of a user in Blender, with the add-on.

    cd tools && python -m operator_fuzz --sequences 10000 --seed 1

Buttons, settings, undo, files, deleting, modes, the add-on off and on. Each sequence begins with an empty scene. No
step may raise anything but what a button reports, and after the last one nothing of the add-on may be left: process,
timer, handler, class, image, temporary file. A number and a seed repeat a sequence.

Blender as a module sometimes crashes in the step `undo`, without the add-on, too: its view layer is gone. In a window
(`--window`) it does not.
"""

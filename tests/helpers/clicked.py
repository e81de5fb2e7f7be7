"""What a click on a button does, without a window."""

import time
from functools import partial
from typing import Any

import bpy

PATIENCE_S = 300.0


def run_job(part: Any, operator: Any, clicked: Any) -> str:
    """Do what an operator of long work does between the click and the end; return its line.

    Args:
        part: imports the add-on's parts by name.
        operator: its class.
        clicked: stands for the operator, with the properties that it is asked with.
    """
    clicked.arguments = partial(operator.arguments, clicked)
    clicked.request = partial(operator.request, clicked)
    for name in ("uses_starter", "build_options", "chosen_files"):
        if hasattr(operator, name):
            setattr(clicked, name, partial(getattr(operator, name), clicked))
    for name in ("title", "panel", "finishable"):
        setattr(clicked, name, getattr(operator, name))
    job = operator.create_job(clicked, bpy.context, None)
    limit = time.monotonic() + PATIENCE_S
    try:
        while not job.ended:
            job.tick()
            picture = job.take_preview()
            if picture is not None:
                part("viewport.picture_overlay").show(picture, job.text)
                assert tuple(bpy.data.images["Perfanim Preview"].size) == picture.shape[1::-1]
            assert time.monotonic() < limit, job.text
            time.sleep(0.02)
    finally:
        job.close()
        part("viewport.picture_overlay").hide()
    return str(operator.on_result(clicked, bpy.context, job.summary))

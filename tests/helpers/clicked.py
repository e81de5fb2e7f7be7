"""What a click on a button does, without a window."""

from functools import partial
from typing import Any

import bpy
from ticking import repeat


def run_job(part: Any, operator: Any, clicked: Any) -> str:
    """Do what an operator of long work does between the click and the end; return its message.

    Args:
        part: Function that imports the add-on's modules by name.
        operator: The operator's class.
        clicked: Stand-in for the operator, with its properties; its `said` gets the texts of the progress.
    """
    clicked.arguments = partial(operator.arguments, clicked)
    clicked.request = partial(operator.request, clicked)
    for name in ("uses_starter", "build_options", "chosen_files", "_performer"):
        if hasattr(operator, name):
            setattr(clicked, name, partial(getattr(operator, name), clicked))
    for name in ("title", "panel", "finishable"):
        setattr(clicked, name, getattr(operator, name))
    job = operator.create_job(clicked, bpy.context, None)
    pictures, said = part("viewport.picture_overlay"), []
    clicked.said = said

    def step() -> None:
        job.tick()
        if job.text not in said:
            said.append(job.text)
        picture = job.take_preview()
        if picture is not None:
            pictures.show(picture, job.text)
            assert tuple(bpy.data.images[pictures.NAME].size) == picture.shape[1::-1]

    try:
        repeat(step, lambda: job.ended, lambda: job.text)
    finally:
        job.close()
        pictures.hide()
    return str(operator.on_result(clicked, bpy.context, job.summary))

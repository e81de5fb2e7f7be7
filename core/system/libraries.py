"""Import names and package names of the libraries that Perfanim needs.

This module imports none of them, so that it can report a broken one.
"""

LIBRARIES = {
    "numpy": "numpy",
    "cv2": "opencv-contrib-python-headless",
    "pythonosc": "python-osc",
    "tomli_w": "tomli-w",
}

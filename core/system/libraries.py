"""Import names and package names of the libraries that Perfanim needs.

Nothing is imported here, so that a fault of one of them can be reported.
"""

LIBRARIES = {
    "numpy": "numpy",
    "scipy": "scipy",
    "cv2": "opencv-contrib-python-headless",
    "pythonosc": "python-osc",
    "tomli_w": "tomli-w",
}

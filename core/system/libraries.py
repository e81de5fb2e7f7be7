"""The libraries that the product needs besides Python's own: what they are imported as, and what they are installed as.

Nothing is imported here, so that whatever is wrong with one of them can be told.
"""

LIBRARIES = {
    "numpy": "numpy",
    "scipy": "scipy",
    "cv2": "opencv-contrib-python-headless",
    "pythonosc": "python-osc",
}

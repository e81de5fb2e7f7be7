"""Types of NumPy arrays."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FloatArray = NDArray[np.float32]  # of 32 bits, where memory or time counts
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]
Image = NDArray[np.uint8]  # (height, width) grey, or (height, width, 3)

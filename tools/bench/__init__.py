"""Benchmarks: the paper's tables and figures, and ours, on motion that is not in the databases.

Each benchmark is a module with a function of the same name. It takes a `Run` (its folders, and the number of
processes) and returns the contents of its JSON file.
"""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))  # metrics shared with the tests

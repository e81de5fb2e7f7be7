"""Tables and figures of the paper, and ours, on motion that the databases do not hold.

Every bench is a module with a function of its name, which takes a `Run` (where it reads and writes, and its processes)
and returns the contents of its JSON file.
"""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))  # measures that tests share

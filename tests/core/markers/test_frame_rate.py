import numpy as np
import pytest
from perfanim.core.errors import TakeError
from perfanim.core.markers.frame_rate import frame_rate


@pytest.mark.parametrize("numbers", [None, np.arange(40)])
def test_impossible_times_are_ignored(numbers):
    times_s = np.arange(40) / 60.0
    times_s[[0, 7]] = np.nan
    times_s[20] += 3600.0
    assert frame_rate(times_s, numbers) == 60.0
    with pytest.raises(TakeError, match="too few frames"):
        frame_rate(np.full(40, np.nan), numbers)

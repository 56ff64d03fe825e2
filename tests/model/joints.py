"""What tests of the model drive joints with."""

import numpy as np


def instants(time):
    """(n - 1, 3) start, middle and end of each of the intervals between (n,) instants."""
    return np.column_stack([time[:-1], (time[1:] + time[:-1]) / 2, time[1:]])

"""The log that the tests of this folder read and damage."""

import numpy as np
import pytest
from log_files import DT, SAMPLES


@pytest.fixture
def columns():
    time = DT * np.arange(SAMPLES)
    return {
        "time": time,
        "torque": np.sin(40 * time),
        "velocity": np.cos(30 * time),
        "position": np.sin(30 * time) / 30,
    }

"""Public records, where they lie beside the repository: they are not ours to bundle."""

import pathlib

import pytest

RECORDS = pathlib.Path(__file__).parents[3] / "shared" / "data"
EMPS, PULSES = RECORDS / "emps" / "DATA_EMPS.mat", RECORDS / "emps" / "DATA_EMPS_PULSES.mat"
PENDULUM = RECORDS / "pendulum"
needs_emps = pytest.mark.skipif(not EMPS.exists(), reason="the EMPS records are not here")
needs_pendulum = pytest.mark.skipif(not PENDULUM.exists(), reason="the pendulum records are not here")

"""A long log costs the memory of its numbers, not of its text; of a part of it, that part's."""

import tracemalloc

import numpy as np
import pytest

from fpjax import read_log
from fpjax.logs.formats import csv_file
from fpjax.logs.formats.table import Request, read_table

ROWS = 150_000
NUMBERS = 4 * 8 * ROWS  # bytes


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("long") / "long.csv"
    time = 1e-3 * np.arange(ROWS)
    columns = np.column_stack([time, np.cos(time), np.sin(time), 1.0 - np.cos(time)])
    np.savetxt(path, columns, delimiter=",", header="time,torque,velocity,position", comments="", fmt="%.15g")
    return path


def peak(read):
    tracemalloc.start()
    try:
        read()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_text_is_read_in_pieces(path, monkeypatch):
    monkeypatch.setattr(csv_file, "PIECE", 2_000)
    assert peak(lambda: read_table(path, Request())) < 3.0 * NUMBERS
    monkeypatch.setattr(csv_file, "PIECE", 10**9)
    assert peak(lambda: read_table(path, Request())) > 4.0 * NUMBERS  # the test would notice


def test_of_a_part_only_that_part_is_held(path, monkeypatch):
    monkeypatch.setattr(csv_file, "PIECE", 2_000)
    assert peak(lambda: read_log(path, start=30.0, stop=31.0)) < 0.8 * NUMBERS  # most of it to find the encoding

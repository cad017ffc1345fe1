"""Benchmarks: `python -m benchmarks compare | thesis | speed | withheld`."""

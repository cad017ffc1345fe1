"""Select: pure decisions from frozen fits and one table of thresholds."""

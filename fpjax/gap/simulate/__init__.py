"""Simulate: windows of a log through the blocks, many lanes at once."""

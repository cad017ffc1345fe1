"""Simulate: lanes of windows through the blocks."""

"""Fit: multiple shooting with the missing torque integrated out."""

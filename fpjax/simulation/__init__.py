"""Simulation of a closed loop: its equations, the solvers, the scan over time, recorded signals and measures."""

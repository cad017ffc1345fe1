"""One run of a closed loop: its equations, solvers and time step, what is recorded and what is measured on the way."""

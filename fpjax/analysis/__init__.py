"""Analysis of a run or a log: an observer's estimates, identified parameters, excitation, gains by pole placement."""

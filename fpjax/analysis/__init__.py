"""What a run or a log tells: estimates of an observer, identified parameters, excitation."""

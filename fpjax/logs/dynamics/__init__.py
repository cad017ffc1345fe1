"""What a log's motion and torque say about the machine: derivatives, regressions, friction against velocity."""

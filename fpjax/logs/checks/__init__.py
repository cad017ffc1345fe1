"""What a user is told about a log: what is in it, and where it is not what it says it is."""

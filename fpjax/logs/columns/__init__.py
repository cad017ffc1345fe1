"""What the columns of a file are called, what quantity each is, and in which unit."""

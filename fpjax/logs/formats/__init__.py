"""One file a format: each gives a `Table`, the columns as they stand in the file."""

"""One file a format: each gives a `RawTable`, the columns as they stand in the file."""

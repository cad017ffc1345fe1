"""Readers of file formats, one module each: every reader gives a `RawTable`, the columns as the file has them."""

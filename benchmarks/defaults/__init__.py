"""What `tune` finds from an untouched file, against the best of 64 starts."""

"""What a command leaves and shows: pictures, run files, TOML text, progress."""

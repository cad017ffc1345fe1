"""Output of the commands: pictures, run files, TOML text, progress on the terminal."""

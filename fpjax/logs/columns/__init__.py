"""Which quantity each column of a file is, and in which unit: from the user's mapping, or from its name."""

"""Whether the diagnosis' own starts lead to the fit that begins at the true values."""

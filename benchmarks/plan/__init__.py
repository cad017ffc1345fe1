"""Whether a planned run decides what an ambiguous log left open, on simulated machines whose cause is withheld."""

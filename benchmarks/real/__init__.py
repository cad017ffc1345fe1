"""The diagnosis on public records of real machines whose cause is documented."""

"""The truth generator: simulated machines with exact sticking. Shares no code with the package."""

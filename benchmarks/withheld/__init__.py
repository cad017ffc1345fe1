"""The withheld check: logs whose effect is known here and kept from the tool that is to find it."""

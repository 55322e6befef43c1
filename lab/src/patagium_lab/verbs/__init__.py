"""Verbs that the laboratory adds to the program `patagium`."""

"""The published experiment's air and stepping, with its errors, for comparison only."""

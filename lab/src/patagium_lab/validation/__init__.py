"""Validation: models of the air beside theory and measurement."""

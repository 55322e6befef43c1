"""Models of the air beside theory and measurement."""

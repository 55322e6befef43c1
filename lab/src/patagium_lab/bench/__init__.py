"""Times of compiled functions beside those of other programs."""

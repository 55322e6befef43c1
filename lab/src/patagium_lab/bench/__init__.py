"""Times of compiled functions, beside other programs'."""

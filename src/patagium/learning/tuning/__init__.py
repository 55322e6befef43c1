"""Settings of a learner, found by search."""

"""Our learners compared with those of other programs."""

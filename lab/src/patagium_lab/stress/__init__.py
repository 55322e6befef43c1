"""What a learner survives."""

"""Learners raced against other programs'."""

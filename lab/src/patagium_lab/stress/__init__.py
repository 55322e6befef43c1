"""Learners under stress: faults, damage, long runs."""

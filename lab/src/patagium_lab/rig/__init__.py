"""A robot on an arm, seen through sensors."""

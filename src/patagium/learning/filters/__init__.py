"""Filters that update weights and their covariance with one sample at a time."""

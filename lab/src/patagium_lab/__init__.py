"""Experiments as programs: the reproduction of the paper, benches, measured cases."""

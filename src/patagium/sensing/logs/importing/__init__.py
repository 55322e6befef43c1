"""From a log of another program to a log of ours: looked at, then brought to one time base."""

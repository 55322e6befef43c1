"""How the robot moved, from what its sensors saw."""

"""Generalized force of the air, from the motion of the robot and the forces on it."""

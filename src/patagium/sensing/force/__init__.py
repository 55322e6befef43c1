"""Force of the air on the robot, from measured motion."""

"""What the air did to the robot, from how it moved."""

"""What maps flows to forces: networks, what they know of the robot, what they remember."""

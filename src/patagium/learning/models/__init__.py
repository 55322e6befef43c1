"""Models of the force of the air: networks, grey boxes, their memory and their description."""

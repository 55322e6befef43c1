"""Models that map flows to forces: networks, their physics, their memory."""

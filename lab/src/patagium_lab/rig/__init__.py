"""The rig: a robot on an arm, measured by sensors."""

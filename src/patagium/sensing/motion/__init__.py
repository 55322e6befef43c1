"""Motion of a robot from its sensors: clocks, smoothers, filters and an online tracker."""

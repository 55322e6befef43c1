"""Laboratory of patagium: studies that run as verbs, each of a plan, a run and a page."""

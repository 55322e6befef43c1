"""Version of the package, as written into every file that patagium makes."""

__version__ = "0.3.0"

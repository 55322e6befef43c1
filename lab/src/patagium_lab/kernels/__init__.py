"""Hand-written C of the laboratory: timing loops and drivers."""

from pathlib import Path

KERNELS = Path(__file__).parent
"""Folder of the sources, for `patagium.native.compiler.load_kernel`."""

"""x."""

import typer

EXAMPLES = ()


def evaluate() -> None:
    """X."""

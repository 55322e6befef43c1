"""x."""

import typer

EXAMPLES = ()


def identify() -> None:
    """X."""

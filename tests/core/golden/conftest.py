"""Option that accepts changed golden files: `pytest tests/core/golden --accept-golden`."""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option; it is known where this folder is named on the command line."""
    parser.addoption("--accept-golden", action="store_true", help="Write the golden files anew.")


@pytest.fixture
def accepted(request: pytest.FixtureRequest) -> bool:
    """Whether changed texts are written instead of refused."""
    return bool(request.config.getoption("--accept-golden", default=False))

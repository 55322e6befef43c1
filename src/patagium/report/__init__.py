"""Pictures and pages from plain arrays: what a result shows of itself.

It knows nothing of robots, flights or learners, so that any layer above may draw.
"""

from patagium.report.page import (
    Block,
    KeyNumber,
    Link,
    Note,
    PageSection,
    Picture,
    Table,
    cell_text,
    picture,
    write_page,
)

__all__ = [
    "Block",
    "KeyNumber",
    "Link",
    "Note",
    "Picture",
    "PageSection",
    "Table",
    "cell_text",
    "picture",
    "write_page",
]

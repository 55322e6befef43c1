"""Pictures and pages from plain arrays: what a result shows of itself.

It knows nothing of robots, flights or learners, so that any layer above may draw.
"""

from patagium.report.blocks import Block, Link, Note, PageSection, Picture, picture
from patagium.report.page import write_page
from patagium.report.tables import Table, cell_text

__all__ = [
    "Block",
    "Link",
    "Note",
    "Picture",
    "PageSection",
    "Table",
    "cell_text",
    "picture",
    "write_page",
]

"""Pictures and pages from plain arrays: what a result shows of itself.

It knows nothing of robots, flights or learners, so that any layer above may draw.
Neglected: animation and three dimensions.
"""

from patagium.report.page import Note, Picture, Section, picture, write_page
from patagium.report.tables import Table, cell_text

__all__ = ["Note", "Picture", "Section", "Table", "cell_text", "picture", "write_page"]

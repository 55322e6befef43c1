from patagium.report.page import Block as Block
from patagium.report.page import KeyNumber as KeyNumber
from patagium.report.page import Link as Link
from patagium.report.page import Note as Note
from patagium.report.page import PageSection as PageSection
from patagium.report.page import Picture as Picture
from patagium.report.page import Table as Table
from patagium.report.page import cell_text as cell_text
from patagium.report.page import picture as picture
from patagium.report.page import write_page as write_page

__all__: list[str]

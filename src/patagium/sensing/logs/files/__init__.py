"""Readers of log files, one module a format, all with the interface `LogFile`."""

from patagium.sensing.logs.files.channels import LogFile
from patagium.sensing.logs.files.opening import open_log, register_reader
from patagium.sensing.logs.files.table_files import column_blocks, table_topic

__all__ = ["LogFile", "column_blocks", "open_log", "register_reader", "table_topic"]

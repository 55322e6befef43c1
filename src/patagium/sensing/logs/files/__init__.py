"""Log files of other programs, one module a format, all read alike: topics, fields, blocks."""

from patagium.sensing.logs.files.channels import (
    Base,
    Block,
    Channel,
    LogFile,
    Topic,
    Wanted,
)
from patagium.sensing.logs.files.opening import open_log

__all__ = ["Base", "Block", "Channel", "LogFile", "Topic", "Wanted", "open_log"]

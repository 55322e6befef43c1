"""Readers of log files, one module a format, all with the interface `LogFile`."""

"""Flights that were measured: files, columns, axes, tables."""

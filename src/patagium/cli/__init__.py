"""The command line: words in, files and sentences out. Nothing imports it."""

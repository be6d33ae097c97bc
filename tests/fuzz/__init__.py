"""Readers against broken and hostile input: `python -m tests.fuzz`, or `make fuzz`."""

"""Searches parameters in a quick model, and confirms what it found in the slow one."""

"""Faults, kills, and want of everything: what survives, and what is lost."""

"""Recordings: readings from files, behind one interface."""

"""Trials: tasks shared out to workers, one file each, and the tables, figures and films of all."""

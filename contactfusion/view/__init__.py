"""Looks at a pipeline in 3D: writes what it saw and decided into a file of rerun, and shows it."""

"""Checks of packages, system libraries, plug-ins, networks, compiled kernels and robots."""

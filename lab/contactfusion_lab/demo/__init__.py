"""The demo: a base pushes a box with fused sensors, and its skin dies half-way."""

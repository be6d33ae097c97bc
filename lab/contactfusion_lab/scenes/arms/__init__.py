"""Arms by URDF."""

"""Robots by URDF: kinematics, surface, spheres, and where their sensors are."""

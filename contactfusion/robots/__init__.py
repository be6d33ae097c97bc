"""Robots by URDF: kinematics, surface, spheres, and the frames of their sensors."""

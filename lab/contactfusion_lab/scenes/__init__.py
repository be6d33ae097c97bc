"""Scenes in PyBullet: a hand that touches, a base that pushes, an arm that grasps."""

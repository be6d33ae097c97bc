"""`experiment press`: arms pressed anywhere, felt by the torques of their joints."""

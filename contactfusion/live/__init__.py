"""A pipeline on a running robot: ROS 2 in and out, a clock, a watchdog."""

"""Recordings of ROS: bags of ROS 1 and 2, MCAP, and folders of them."""

from contactfusion.recordings.ros.recording import RosConfig, RosRecording

__all__ = ["RosConfig", "RosRecording"]

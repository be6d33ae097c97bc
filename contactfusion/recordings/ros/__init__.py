"""Recordings of ROS: bags of ROS 1 and 2, MCAP, and folders of them."""

from contactfusion.recordings.ros.messages import RawMessage, Tap
from contactfusion.recordings.ros.recording import RosConfig, RosRecording

__all__ = ["RawMessage", "RosConfig", "RosRecording", "Tap"]

"""Recordings of ROS: bags of ROS 1 and 2, MCAP, and folders of them."""

from contactfusion.recordings.ros.recording import RawMessage, RosConfig, RosRecording, Tap

__all__ = ["RawMessage", "RosConfig", "RosRecording", "Tap"]

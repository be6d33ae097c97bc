"""Writes a bag with the tools of ROS 1, as Debian's python3-rosbag has them.

Run by the system's Python, not by ours: /usr/bin/python3 write_ros1_bag.py BAG < MESSAGES.
Each line of MESSAGES is a topic, a type, a stamp [ns since 1970] and the fields, as JSON.
"""

import json
import sys

# these are where the system's Python looks, and never in our environment
import genpy  # type: ignore[import-not-found]
import rosbag  # type: ignore[import-not-found]
from roslib.message import get_message_class  # type: ignore[import-not-found]

with rosbag.Bag(sys.argv[1], "w") as bag:
    for number, line in enumerate(sys.stdin):
        topic, kind, stamp, fields = json.loads(line)
        message = get_message_class(kind)()
        time = genpy.Time(*divmod(stamp, 1_000_000_000))
        genpy.message.fill_message_args(message, [fields])
        if hasattr(message, "header"):
            message.header.stamp, message.header.seq = time, number
        for transform in getattr(message, "transforms", ()):
            transform.header.stamp = time
        bag.write(topic, message, time)

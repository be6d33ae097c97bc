"""A node of rclpy that sends wrenches and clouds and hears contacts; it needs ROS 2 alone.

python live_peer.py SECONDS RATE: prints a line of JSON on what was sent, heard, and how late.
"""

# pyright: reportMissingImports=false

import json
import sys
import threading
import time

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2, PointField

POINTS = 5000
CONTACTS = "/contactfusion/contacts/strongest"


def main(seconds: float, rate: float) -> None:
    """Send for so long [s], wrenches at a rate [Hz] and clouds at 10 Hz."""
    rclpy.init()
    node = Node("robot")
    wrenches = node.create_publisher(WrenchStamped, "/wrist", 1000)
    clouds = node.create_publisher(PointCloud2, "/eye", 10)
    late: list[float] = []

    def hear(contact: WrenchStamped) -> None:
        stamp = contact.header.stamp
        late.append(time.time() - stamp.sec - 1e-9 * stamp.nanosec)

    node.create_subscription(WrenchStamped, CONTACTS, hear, 1000)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    hearing = threading.Thread(target=executor.spin, daemon=True)
    hearing.start()
    while not (
        wrenches.get_subscription_count()
        and clouds.get_subscription_count()
        and node.count_publishers(CONTACTS)
    ):
        time.sleep(0.05)
    time.sleep(1.0)  # both sides know of each other
    cloud = _cloud()
    began, sent, sent_clouds = time.perf_counter(), 0, 0
    while (now := time.perf_counter() - began) < seconds:
        if now * 10.0 >= sent_clouds:
            cloud.header.stamp = node.get_clock().now().to_msg()
            clouds.publish(cloud)
            sent_clouds += 1
        wrench = WrenchStamped()
        wrench.header.frame_id = "probe"
        wrench.header.stamp = node.get_clock().now().to_msg()
        wrench.wrench.force.z = -5.0 - 0.1 * np.sin(now)
        wrench.wrench.torque.y = 0.1
        wrenches.publish(wrench)
        sent += 1
        time.sleep(max(0.0, sent / rate - (time.perf_counter() - began)))
    time.sleep(1.0)
    p50, p99 = (1e3 * float(np.quantile(late, q)) for q in (0.5, 0.99))
    counts = {"wrenches": sent, "clouds": sent_clouds, "contacts": len(late)}
    print(json.dumps({**counts, "p50": p50, "p99": p99}), flush=True)
    rclpy.shutdown()


def _cloud() -> PointCloud2:
    """Points on a half sphere about the probe."""
    at = np.random.default_rng(0).normal(size=(POINTS, 3))
    at = np.abs(0.06 * at / np.linalg.norm(at, axis=1, keepdims=True)).astype(np.float32)
    cloud = PointCloud2(height=1, width=POINTS, point_step=12, row_step=12 * POINTS, is_dense=True)
    cloud.header.frame_id = "probe"
    cloud.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate("xyz")
    ]
    cloud.data = at.tobytes()
    return cloud


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]))

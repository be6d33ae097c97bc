"""A robot of rclpy: peer.py OUT IN; see peers.py. It needs ROS 2 alone."""

# pyright: reportMissingImports=false

import sys
import threading
import time

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

WRENCHES, EVERY, BYTES = 5000, 100, 120_000
RELIABLE = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


def main(out: str, into: str) -> None:
    """Send on one topic and those beside it, and print the numbers of what comes on the other."""
    rclpy.init()
    node = rclpy.create_node("robot")
    wrenches = node.create_publisher(WrenchStamped, out, RELIABLE)
    fleeting = node.create_publisher(WrenchStamped, f"{out}_best_effort", BEST_EFFORT)
    clouds = node.create_publisher(PointCloud2, f"{out}_cloud", RELIABLE)
    heard_at = time.monotonic()

    def hear(*words: object) -> None:
        nonlocal heard_at
        heard_at = time.monotonic()
        print(*words)

    def hear_wrench(wrench: WrenchStamped) -> None:
        hear("wrench", round(1e9 * wrench.wrench.force.x))

    def hear_cloud(cloud: PointCloud2) -> None:
        hear("cloud", cloud.row_step, len(cloud.data))

    node.create_subscription(WrenchStamped, into, hear_wrench, RELIABLE)
    node.create_subscription(PointCloud2, f"{into}_cloud", hear_cloud, RELIABLE)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    hearing = threading.Thread(target=executor.spin)
    hearing.start()
    while not (wrenches.get_subscription_count() and node.count_publishers(into)):
        time.sleep(0.05)
    time.sleep(1.0)
    for end in node.get_publishers_info_by_topic(into):
        print("hash", end.topic_type_hash)
    wrench, cloud = WrenchStamped(), PointCloud2(height=1, width=BYTES, point_step=1)
    wrench.header.frame_id = cloud.header.frame_id = "probe"
    wrench.wrench.force.z, wrench.wrench.torque.y = -5.0, 0.1
    cloud.data = bytes(BYTES)
    began = time.monotonic()
    for number in range(WRENCHES):
        time.sleep(max(0.0, began + 1e-3 * number - time.monotonic()))
        wrench.header.stamp = node.get_clock().now().to_msg()
        wrench.wrench.force.x = 1e-9 * number
        wrenches.publish(wrench)
        fleeting.publish(wrench)
        if number % EVERY == 0:
            cloud.row_step = number // EVERY
            clouds.publish(cloud)
    while time.monotonic() < heard_at + 2.0:
        time.sleep(0.1)
    executor.shutdown()
    hearing.join()
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])

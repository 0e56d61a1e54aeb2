"""Reader by ROS 2's own package rclpy, run in its own environment.

Reads two lists of messages in hexadecimal digits, of forces and of joint states; prints the
messages decoded by its middleware, and the hashes of both types in an rclpy node.
"""
# pyright: basic, reportMissingImports=false

import json
import sys

import rclpy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

forces, joints = json.load(sys.stdin)
rclpy.init()
node = rclpy.create_node("pincette_probe")
hashes = []
for topic, kind in (("force", Float64), ("joints", JointState)):
    node.create_publisher(kind, topic, 10)
    (told,) = node.get_publishers_info_by_topic(topic)
    hashes.append([told.topic_type, str(told.topic_type_hash)])
read = [deserialize_message(bytes.fromhex(one), JointState) for one in joints]
print(
    json.dumps(
        {
            "hashes": hashes,
            "force_mN": [deserialize_message(bytes.fromhex(one), Float64).data for one in forces],
            "joints": [[list(one.name), list(one.position), list(one.effort)] for one in read],
            "stamps_s": [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in read],
        }
    )
)
node.destroy_node()
rclpy.shutdown()

"""A subscriber in Python: writes a line of JSON for each message of one camera, and for how each of its connections runs.

listener.py FILE CAMERA, where CAMERA is the name before /image_raw.
"""

import json
import sys
import threading
import xmlrpc.client

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import CameraInfo, Image

file = open(sys.argv[1], "w")
camera = sys.argv[2]
lock = threading.Lock()
connections = []


def tell(kind, **what):
    with lock:
        print(json.dumps({"kind": kind, **what}), file=file, flush=True)


def image(kind):
    def received(message):
        stamp = message.header.stamp.to_nsec()
        shape = [message.encoding, message.width, message.height, message.step, message.is_bigendian]
        if kind == "image" and not connections:
            connections.append(transports(message._connection_header["callerid"]))
            tell("connections", transports=connections[0])
        first = next((y for y in range(message.height) if not any(row(message, y))), message.height)
        tell(kind, stamp=stamp, frame_id=message.header.frame_id, shape=shape, bytes=len(message.data), first_black_row=first)

    return received


def row(message, y):
    return message.data[y * message.step : (y + 1) * message.step]


def info(message):
    tell("info", stamp=message.header.stamp.to_nsec(), size=[message.width, message.height], k=message.K)


def diagnostics(message):
    for status in message.status:
        values = {value.key: value.value for value in status.values}
        tell("diagnostics", name=status.name, level=status.level, message=status.message, values=values)


def transports(node):
    """How a node's publication of images reaches each of its subscribers."""
    master = rosgraph.Master(rospy.get_name())
    _, _, connections = xmlrpc.client.ServerProxy(master.lookupNode(node)).getBusInfo(rospy.get_name())
    return sorted(transport for _, _, direction, transport, topic, *_ in connections if direction == "o" and topic == camera + "/image_raw")


rospy.init_node("listener", anonymous=True)
rospy.Subscriber(camera + "/image_raw", Image, image("image"))
rospy.Subscriber(camera + "/mask", Image, image("mask"))
rospy.Subscriber(camera + "/camera_info", CameraInfo, info)
rospy.Subscriber("/diagnostics", DiagnosticArray, diagnostics)
rospy.spin()

"""Writes a bag with PyPI `rosbags`, as a recording of ROS 2 Jazzy (metadata version 9).

Usage: write_bag.py BAG

Ten geometry_msgs/PointStamped on /point, x counting from 0, 1 ms apart.
"""

import sys

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

ANY_TIME = QosTime(0, 0)
QOS = Qos(
    QosHistory.KEEP_LAST,
    5,
    QosReliability.RELIABLE,
    QosDurability.VOLATILE,
    ANY_TIME,
    ANY_TIME,
    QosLiveliness.AUTOMATIC,
    ANY_TIME,
    False,
)


def main():
    store = get_typestore(Stores.ROS2_JAZZY)
    point_stamped = store.types["geometry_msgs/msg/PointStamped"]
    header, time, point = (
        store.types[name]
        for name in (
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
            "geometry_msgs/msg/Point",
        )
    )
    with Writer(sys.argv[1], version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection(
            "/point", point_stamped.__msgtype__, typestore=store, offered_qos_profiles=[QOS]
        )
        for n in range(10):
            message = point_stamped(header(time(1, n), "bridge"), point(float(n), 0.5, -0.25))
            data = store.serialize_cdr(message, point_stamped.__msgtype__)
            bag.write(connection, 1_000_000_000 + n * 1_000_000, data)


if __name__ == "__main__":
    main()

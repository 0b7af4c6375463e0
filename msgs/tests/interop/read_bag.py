"""Reads a bag with other people's readers and compares every field with what was written.

Usage: read_bag.py BAG EXPECTED.json

BAG is a rosbag2 directory or a .mcap file. EXPECTED.json is a list of messages in the order they
were written: {"topic", "type", "log_time_ns", "cdr_hex", "fields"}. The readers are PyPI `rosbags`
(with the definitions embedded in the bag) and, for the .mcap inside, PyPI `mcap-ros2-support`.
Prints what was compared; exits with 1 and the difference when anything differs.
"""

import json
import pathlib
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


class Difference(Exception):
    """Something differs from what was written."""


def plain(value):
    """A message of either reader as plain dictionaries, lists, texts and numbers."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)  # one is the `byte` of ROS 2
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if hasattr(value, "__dataclass_fields__"):
        names = value.__dataclass_fields__
    elif hasattr(value, "__slots__"):
        names = value.__slots__
    else:
        return value
    return {
        name: plain(getattr(value, name))
        for name in names
        if not (name.startswith("_") or name.isupper())
    }


def same(where, found, expected):
    """Compares exactly: type of container, names, order, and every number bit for bit."""
    if isinstance(expected, dict):
        if sorted(found) != sorted(expected):
            raise Difference(f"{where}: fields {sorted(found)}, expected {sorted(expected)}")
        for name, entry in expected.items():
            same(f"{where}.{name}", found[name], entry)
    elif isinstance(expected, list):
        if len(found) != len(expected):
            raise Difference(f"{where}: {len(found)} entries, expected {len(expected)}")
        for index, entry in enumerate(expected):
            same(f"{where}[{index}]", found[index], entry)
    elif found != expected:
        raise Difference(f"{where}: {found!r}, expected {expected!r}")


def typestore_of(bag):
    """Only what the bag itself defines: nothing is taken from a ROS installation."""
    store = get_typestore(Stores.EMPTY)
    types = {}
    for connection in bag.connections:
        types.update(get_types_from_msg(connection.msgdef.data, connection.msgtype))
    store.register(types)
    return store, set(types)


def compare_standard_types(store, defined):
    """The embedded standard definitions are those of ROS 2: the same hash of the interface."""
    ros = get_typestore(Stores.ROS2_JAZZY)
    names = sorted(name for name in defined if name in ros.fielddefs)
    for name in names:
        if store.hash_rihs01(name) != ros.hash_rihs01(name):
            raise Difference(f"{name} is not what ROS 2 Jazzy defines")
    return len(names)


def compare_with_rosbags(path, expected):
    with Reader(path) as bag:
        store, defined = typestore_of(bag)
        found = list(bag.messages())
        if len(found) != len(expected):
            raise Difference(f"rosbags finds {len(found)} messages, expected {len(expected)}")
        if bag.message_count != len(expected):
            raise Difference(f"rosbags is told of {bag.message_count} messages")
        for index, ((connection, time_ns, data), want) in enumerate(zip(found, expected)):
            where = f"rosbags: message {index} on {want['topic']}"
            same(f"{where}: topic", connection.topic, want["topic"])
            same(f"{where}: type", connection.msgtype, want["type"])
            # A bare file has no metadata.yaml, where rosbags looks; a bag of rosbags has none in its channels to be copied.
            if path.is_dir() and connection.msgtype.startswith("abbe_msgs/"):
                same(f"{where}: hash", connection.digest, store.hash_rihs01(connection.msgtype))
            same(f"{where}: time", time_ns, want["log_time_ns"])
            same(f"{where}: bytes", bytes(data).hex(), want["cdr_hex"])
            message = store.deserialize_cdr(data, connection.msgtype)
            same(where, plain(message), want["fields"])
            again = bytes(store.serialize_cdr(message, connection.msgtype))
            same(f"{where}: bytes by its own writer", again.hex(), want["cdr_hex"])
        types = compare_standard_types(store, defined)
    print(f"rosbags: {len(found)} messages equal; {types} standard definitions equal")


def compare_with_mcap_ros2(path, expected):
    number = lambda file: int(file.stem.rpartition("_")[2])
    files = [path] if path.suffix == ".mcap" else sorted(path.glob("*.mcap"), key=number)
    found = []
    for file in files:
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            if reader.get_header().profile != "ros2":
                raise Difference(f"profile is {reader.get_header().profile!r}, expected 'ros2'")
            found += reader.iter_decoded_messages(log_time_order=False)
    if len(found) != len(expected):
        raise Difference(f"mcap finds {len(found)} messages, expected {len(expected)}")
    for index, ((schema, channel, record, message), want) in enumerate(zip(found, expected)):
        where = f"mcap: message {index} on {want['topic']}"
        same(f"{where}: topic", channel.topic, want["topic"])
        same(f"{where}: type", schema.name, want["type"])
        if schema.name.startswith("abbe_msgs/"):
            same(f"{where}: hash", channel.metadata["topic_type_hash"][:7], "RIHS01_")
        same(f"{where}: time", record.log_time, want["log_time_ns"])
        same(where, plain(message), want["fields"])
    print(f"mcap-ros2-support: {len(found)} messages equal")


def main():
    path = pathlib.Path(sys.argv[1])
    expected = json.loads(pathlib.Path(sys.argv[2]).read_text(encoding="utf-8"))
    try:
        compare_with_rosbags(path, expected)
        compare_with_mcap_ros2(path, expected)
    except Difference as difference:
        sys.exit(f"{path}: {difference}")


if __name__ == "__main__":
    main()

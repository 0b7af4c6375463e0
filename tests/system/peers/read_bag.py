"""Reads a bag with PyPI `rosbags` and writes every message down.

Usage: read_bag.py BAG OUT.json

BAG is a rosbag2 directory. Only the definitions embedded in the bag are used. OUT.json is a list of
{"topic", "type", "log_time_ns", "fields"} in the order of the bag, null for NaN.
"""

import json
import math
import pathlib
import sys

from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


def plain(value):
    if hasattr(value, "__dataclass_fields__"):
        names = (name for name in value.__dataclass_fields__ if not (name.startswith("_") or name.isupper()))
        return {name: plain(getattr(value, name)) for name in names}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def main(bag, out):
    found = []
    with Reader(pathlib.Path(bag)) as reader:
        store = get_typestore(Stores.EMPTY)
        types = {}
        for connection in reader.connections:
            types.update(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        store.register(types)
        for connection, log_time_ns, cdr in reader.messages():
            message = store.deserialize_cdr(cdr, connection.msgtype)
            found.append(
                {
                    "topic": connection.topic,
                    "type": connection.msgtype,
                    "log_time_ns": log_time_ns,
                    "fields": plain(message),
                }
            )
    with open(out, "w", encoding="utf-8") as file:
        json.dump(found, file, allow_nan=False)
    print(f"{len(found)} messages")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])

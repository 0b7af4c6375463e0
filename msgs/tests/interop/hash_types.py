"""RIHS01 hashes of messages as PyPI `rosbags` computes them, and as ROS 2 Jazzy has them.

Usage: hash_types.py DEFINITIONS.json

DEFINITIONS.json maps full names to the text of `.msg` files. Prints one JSON object: by name the hash of the text, and that of
Jazzy's own message of the name, null where there is none.
"""

import json
import pathlib
import sys

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

texts = json.loads(pathlib.Path(sys.argv[1]).read_text(encoding="utf-8"))
ours, jazzy = get_typestore(Stores.EMPTY), get_typestore(Stores.ROS2_JAZZY)
types = {}
for name, text in texts.items():
    types.update(get_types_from_msg(text, name))
ours.register(types)
print(json.dumps({
    name: [ours.hash_rihs01(name), jazzy.hash_rihs01(name) if name in jazzy.fielddefs else None] for name in texts
}))

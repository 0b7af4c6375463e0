"""The quality of service of each topic of a bag, as PyPI `rosbags` reads it.

Usage: read_qos.py BAG

Prints one JSON object: by topic, the profiles that it was offered with.
"""

import json
import pathlib
import sys

from rosbags.rosbag2 import Reader


def plain(profile):
    return {
        "history": profile.history.name,
        "depth": profile.depth,
        "reliability": profile.reliability.name,
        "durability": profile.durability.name,
    }


def main():
    with Reader(pathlib.Path(sys.argv[1])) as bag:
        found = {one.topic: [plain(profile) for profile in one.ext.offered_qos_profiles] for one in bag.connections}
    print(json.dumps(found))


if __name__ == "__main__":
    main()

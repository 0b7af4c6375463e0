"""A user on Zenoh, as a ROS 2 program on rmw_zenoh is one: PyPI `eclipse-zenoh`, with `rosbags` for the messages.

Usage: zenoh_user.py DOMAIN NAMESPACE READINGS.json

READINGS.json is a list of `abbe_msgs/ScaleReading` in CDR, in hex. The program is the router on this host. It waits until a node
takes readings and one gives corrected coordinates, by their liveliness tokens, sends what is no reading, then the readings,
and takes the coordinates until each reading has its answer.

Prints one JSON object: tokens that it saw, coordinates (doubles as the whole numbers of their bits), and the number that each
sample carries beside it. Exits with 1 and a reason when what it waits for does not come.
"""

import json
import pathlib
import struct
import sys
import threading
import time

import zenoh
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

PATIENCE_S = 60
MESSAGES = pathlib.Path(__file__).parents[3] / "msgs" / "msg"
GID = bytes(range(16))


def types():
    store = get_typestore(Stores.ROS2_JAZZY)
    for file in sorted(MESSAGES.glob("*.msg")):
        store.register(get_types_from_msg(file.read_text(encoding="utf-8"), f"abbe_msgs/msg/{file.stem}"))
    return store


def key(store, domain, topic, name):
    return f"{domain}{topic}/abbe_msgs::msg::dds_::{name}_/{store.hash_rihs01(f'abbe_msgs/msg/{name}')}"


def wait(done, what):
    deadline = time.monotonic() + PATIENCE_S
    while not done():
        time.sleep(0.01)
        if time.monotonic() > deadline:
            sys.exit(f"{what} did not come within {PATIENCE_S} s")


def router():
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", '["tcp/[::]:7447"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def bits(values):
    return [struct.unpack("<Q", struct.pack("<d", value))[0] for value in values]


def main():
    domain, namespace, file = sys.argv[1:]
    readings = [bytes.fromhex(one) for one in json.loads(pathlib.Path(file).read_text(encoding="utf-8"))]
    store, lock, tokens, taken = types(), threading.Lock(), set(), []
    session = router()

    def seen(sample):
        with lock:
            tokens.add(str(sample.key_expr))

    def take(sample):
        number, sent_ns, length, gid = struct.unpack("<qqB16s", sample.attachment.to_bytes())
        one = store.deserialize_cdr(sample.payload.to_bytes(), "abbe_msgs/msg/CorrectedCoordinates")
        with lock:
            taken.append({"sequence": one.sequence, "corrected_m": bits(one.corrected_m), "status": one.status,
                          "covariance_m2": bits(one.covariance_m2), "frame": one.header.frame_id, "number": number,
                          "gid": gid.hex(), "length": length, "age_s": time.time() - sent_ns * 1e-9})

    watching = session.liveliness().declare_subscriber(f"@ros2_lv/{domain}/**", seen, history=True)
    taking = session.declare_subscriber(key(store, domain, f"/{namespace}/corrected", "CorrectedCoordinates"), take)
    has = lambda end, topic: any(f"/{end}/" in one and f"%{namespace}%{topic}/" in one for one in list(tokens))
    wait(lambda: has("MS", "scale%reading") and has("MP", "corrected"), "the nodes")

    name = key(store, domain, f"/{namespace}/scale/reading", "ScaleReading")
    attachment = lambda number: struct.pack("<qqB16s", number, time.time_ns(), 16, GID)
    sending = session.declare_publisher(name)
    sending.put(readings[0])
    sending.put(readings[0], attachment=b"no attachment")
    sending.put(b"\x00\x01\x00\x00no reading", attachment=attachment(1))
    sending.put(bytes(1 << 17), attachment=attachment(2))
    sending.put(b"", attachment=attachment(3))
    session.delete(name)
    for number, reading in enumerate(readings, start=4):
        message = store.deserialize_cdr(reading, "abbe_msgs/msg/ScaleReading")
        sending.put(bytes(store.serialize_cdr(message, "abbe_msgs/msg/ScaleReading")), attachment=attachment(number))
        time.sleep(0.001)
    wait(lambda: len(taken) >= len(readings), "an answer to each reading")
    time.sleep(0.2)
    taking.undeclare()
    watching.undeclare()
    with lock:
        print(json.dumps({"tokens": sorted(tokens), "taken": taken}))
    session.close()


main()

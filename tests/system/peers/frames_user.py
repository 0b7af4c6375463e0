"""What RViz and tf2 take from a graph, by others: PyPI `cyclonedds`, types written from the .msg files by hand.

Usage: frames_user.py DOMAIN NAMESPACE COUNT

Joins late, takes what stands (`/tf_static`, `robot_description`: transient local) and COUNT messages of `/tf`, and prints
them as one JSON object. Exits with 1 and a reason when something does not come.
"""

import json
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

PATIENCE_S = 60.0


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


def frame(one):
    moved, turned = one.transform.translation, one.transform.rotation
    return {
        "stamp_ns": one.header.stamp.sec * 1_000_000_000 + one.header.stamp.nanosec,
        "parent": one.header.frame_id,
        "child": one.child_frame_id,
        "moved_m": [moved.x, moved.y, moved.z],
        "turned": [turned.x, turned.y, turned.z, turned.w],
    }


def qos(durability):
    return Qos(
        Policy.Reliability.Reliable(duration(seconds=1)),
        durability,
        Policy.History.KeepLast(100),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    )


def reader(participant, name, kind, durability):
    policies = qos(durability)
    return DataReader(participant, Topic(participant, f"rt{name}", kind, qos=policies), qos=policies)


def main(domain, namespace, count):
    participant = DomainParticipant(int(domain))
    moving = reader(participant, "/tf", TFMessage, Policy.Durability.Volatile)
    found = {"moving": [], "standing": [], "description": None}
    deadline = time.monotonic() + PATIENCE_S

    def until(done, what):
        while not done():
            if time.monotonic() > deadline:
                sys.exit(f"{what} did not come within {PATIENCE_S} s")
            time.sleep(0.01)

    def take_moving():
        found["moving"] += [[frame(one) for one in message.transforms] for message in moving.take(N=100)]
        return len(found["moving"]) >= int(count)

    until(take_moving, "/tf")
    # Only now, long after it was published.
    standing = reader(participant, "/tf_static", TFMessage, Policy.Durability.TransientLocal)
    description = reader(participant, f"/{namespace}/robot_description", String, Policy.Durability.TransientLocal)

    def take_standing():
        found["standing"] += [frame(one) for message in standing.take(N=10) for one in message.transforms]
        return found["standing"]

    def take_description():
        for message in description.take(N=10):
            found["description"] = message.data
        return found["description"]

    until(take_standing, "/tf_static")
    until(take_description, "the description")
    print(json.dumps(found))


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])

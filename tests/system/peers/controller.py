"""A controller, a tracer and sensors on ROS 2 by others: PyPI `cyclonedds`, types written from the .msg files by hand.

Usage: controller.py DOMAIN NAMESPACE READINGS.json

READINGS.json is a list of {"stamp": [s, ns], "joints": [[name, m], ...], "frame": text, "range_m": m}. Publishes each as
`sensor_msgs/JointState` on `axes` and as `sensor_msgs/Range` of frame `tracer` on `distance`, both in NAMESPACE, 2 ms apart,
after a `Temperature` of 20.5, a `FluidPressure` of 100 000 and a `RelativeHumidity` of 0.4 with the stamp of the first
reading. Exits with 1 and a reason when nobody listens.
"""

import json
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float32, float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration

PATIENCE_S = 40.0
PERIOD_S = 0.002


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class Range(IdlStruct, typename="sensor_msgs::msg::dds_::Range_"):
    header: Header
    radiation_type: uint8
    field_of_view: float32
    min_range: float32
    max_range: float32
    range: float32
    variance: float32


@dataclass
class Temperature(IdlStruct, typename="sensor_msgs::msg::dds_::Temperature_"):
    header: Header
    temperature: float64
    variance: float64


@dataclass
class FluidPressure(IdlStruct, typename="sensor_msgs::msg::dds_::FluidPressure_"):
    header: Header
    fluid_pressure: float64
    variance: float64


@dataclass
class RelativeHumidity(IdlStruct, typename="sensor_msgs::msg::dds_::RelativeHumidity_"):
    header: Header
    relative_humidity: float64
    variance: float64


def main(domain, namespace, path):
    with open(path, encoding="utf-8") as file:
        readings = json.load(file)
    participant = DomainParticipant(int(domain))
    qos = Qos(
        Policy.Reliability.Reliable(duration(seconds=1)),
        Policy.History.KeepLast(4096),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    )

    def writer(name, kind):
        return DataWriter(participant, Topic(participant, f"rt/{namespace}/{name}", kind, qos=qos), qos=qos)

    axes, distance = writer("axes", JointState), writer("distance", Range)
    sensors = [
        (writer("air", Temperature), lambda header: Temperature(header, 20.5, 0.0)),
        (writer("pressure", FluidPressure), lambda header: FluidPressure(header, 100_000.0, 0.0)),
        (writer("humidity", RelativeHumidity), lambda header: RelativeHumidity(header, 0.4, 0.0)),
    ]
    writers = [axes, distance] + [one for one, _ in sensors]
    deadline = time.monotonic() + PATIENCE_S
    while not all(one.get_matched_subscriptions() for one in writers):
        if time.monotonic() > deadline:
            sys.exit(f"nobody listens: {[len(one.get_matched_subscriptions()) for one in writers]}")
        time.sleep(0.02)
    time.sleep(0.5)  # the other side finds its writers, too

    first = Time(*readings[0]["stamp"])
    for one, message in sensors:
        one.write(message(Header(first, "hall")))
    time.sleep(0.3)
    for reading in readings:
        stamp = Time(*reading["stamp"])
        names, positions = zip(*reading["joints"]) if reading["joints"] else ((), ())
        axes.write(JointState(Header(stamp, reading["frame"]), list(names), list(positions), [], []))
        distance.write(Range(Header(stamp, "tracer"), 1, 0.01, 0.1, 20.0, reading["range_m"], 0.0))
        time.sleep(PERIOD_S)
    time.sleep(2.0)
    print(json.dumps({"sent": len(readings)}))


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])

"""A ROS 2 program by others: publishes scale readings over DDS and takes corrected coordinates.

Usage: dds_user.py DOMAIN NAMESPACE READINGS.json OUT.json READERS

READINGS.json is a list of abbe_msgs/ScaleReading as objects, null for NaN. READERS is how many
subscribers of the readings there will be. Writes what arrived on the topics `corrected` and
`corrected_point` as {"corrected": [...], "points": [...]} in the order of arrival. Everything is
PyPI `cyclonedds`; the types are written from the .msg files by hand. Exits with 1 and a reason when
no connection comes about; what is missing in the end is for the caller to judge.
"""

import json
import math
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

PROBE = 2**63  # sequence of readings that only find out whether everyone is connected
PATIENCE_S = 20.0
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
class ScaleReading(IdlStruct, typename="abbe_msgs::msg::dds_::ScaleReading_"):
    header: Header
    sequence: uint64
    reading_m: array[float64, 3]
    offset_m: array[float64, 3]
    covariate_names: sequence[str]
    covariate_values: sequence[float64]
    covariate_age_s: sequence[float64]


@dataclass
class CorrectedCoordinates(IdlStruct, typename="abbe_msgs::msg::dds_::CorrectedCoordinates_"):
    header: Header
    sequence: uint64
    reading_m: array[float64, 3]
    offset_m: array[float64, 3]
    geometric_correction_m: array[float64, 3]
    effect_correction_m: array[float64, 3]
    residual_correction_m: array[float64, 3]
    corrected_valid: bool
    corrected_m: array[float64, 3]
    covariance_m2: array[float64, 9]
    status: uint8
    model_sha256: array[uint8, 32]
    residual_model_sha256: array[uint8, 32]


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class PointStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PointStamped_"):
    header: Header
    point: Point


def numbers(values):
    return [math.nan if value is None else value for value in values]


def reading_of(fields):
    stamp = fields["header"]["stamp"]
    return ScaleReading(
        header=Header(Time(stamp["sec"], stamp["nanosec"]), fields["header"]["frame_id"]),
        sequence=fields["sequence"],
        reading_m=numbers(fields["reading_m"]),
        offset_m=numbers(fields["offset_m"]),
        covariate_names=fields["covariate_names"],
        covariate_values=fields["covariate_values"],
        covariate_age_s=fields["covariate_age_s"],
    )


def plain(value):
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__}
    if isinstance(value, (list, tuple, bytes)):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def main(domain, namespace, readings_path, out_path, readers):
    with open(readings_path, encoding="utf-8") as file:
        readings = [reading_of(fields) for fields in json.load(file)]
    participant = DomainParticipant(int(domain))
    # XCDR1 is what ROS 2 speaks; streams are best effort.
    qos = Qos(
        Policy.Reliability.BestEffort,
        Policy.History.KeepLast(4096),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    )

    def topic(name, kind):
        return Topic(participant, f"rt/{namespace}/{name}", kind, qos=qos)

    writer = DataWriter(participant, topic("scale/reading", ScaleReading), qos=qos)
    corrected = DataReader(participant, topic("corrected", CorrectedCoordinates), qos=qos)
    points = DataReader(participant, topic("corrected_point", PointStamped), qos=qos)

    probe = reading_of(json.load(open(readings_path, encoding="utf-8"))[0])
    probe.sequence = PROBE
    came = {"corrected": 0, "points": 0}
    deadline = time.monotonic() + PATIENCE_S
    while not (all(came.values()) and len(writer.get_matched_subscriptions()) >= int(readers)):
        if time.monotonic() > deadline:
            sys.exit(f"not connected within {PATIENCE_S} s: {came}, {len(writer.get_matched_subscriptions())} readers")
        writer.write(probe)
        time.sleep(0.02)
        came["corrected"] += len(corrected.take(N=100))
        came["points"] += len(points.take(N=100))
    time.sleep(0.5)  # the last probes arrive
    corrected.take(N=4096)
    points.take(N=4096)

    found = {"corrected": [], "points": []}

    def collect():
        found["corrected"] += [plain(sample) for sample in corrected.take(N=4096)]
        found["points"] += [plain(sample) for sample in points.take(N=4096)]

    for reading in readings:
        writer.write(reading)
        time.sleep(PERIOD_S)
        collect()
    deadline = time.monotonic() + 2.0
    while len(found["corrected"]) < len(readings) and time.monotonic() < deadline:
        time.sleep(0.01)
        collect()
    time.sleep(0.1)
    collect()
    with open(out_path, "w", encoding="utf-8") as file:
        json.dump(found, file, allow_nan=False)
    print(f"{len(readings)} sent, {len(found['corrected'])} corrected, {len(found['points'])} points")


if __name__ == "__main__":
    if len(sys.argv) != 6:
        sys.exit(__doc__)
    main(*sys.argv[1:])

"""A caller of services as ROS 2 on Cyclone DDS writes them: 16 bytes (who, which call) before request and reply.

Usage: cyclone_caller.py DOMAIN NODE_WITH_PARAMETERS NODE_WITH_MODEL

Lists, gets and describes the parameters of the first node, sends it 1000 requests that are none, gets them once more,
and calls `reload_model` of the second. The head is that of rmw_cyclonedds_cpp (`cdds_request_header_t`), written as part
of each type, which gives the same bytes; everything else is PyPI `cyclonedds`. Prints one JSON object.
"""

import json
import sys
import time
from dataclasses import dataclass, field

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int64, sequence, uint8, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

PATIENCE_S = 20.0
WHO = 0x1F2E3D4C5B6A7988
QOS = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.History.KeepLast(10),
    Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
)


@dataclass
class Head(IdlStruct):
    who: uint64
    call: int64


@dataclass
class Trigger(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Request_"):
    head: Head
    unused: uint8 = 0


@dataclass
class Triggered(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Response_"):
    head: Head
    success: bool
    message: str


@dataclass
class List(IdlStruct, typename="rcl_interfaces::srv::dds_::ListParameters_Request_"):
    head: Head
    prefixes: sequence[str] = field(default_factory=list)
    depth: uint64 = 0


@dataclass
class Listed(IdlStruct, typename="rcl_interfaces::srv::dds_::ListParameters_Response_"):
    head: Head
    names: sequence[str]
    prefixes: sequence[str]


@dataclass
class Get(IdlStruct, typename="rcl_interfaces::srv::dds_::GetParameters_Request_"):
    head: Head
    names: sequence[str]


@dataclass
class Value(IdlStruct):
    type: uint8
    bool_value: bool
    integer_value: int64
    double_value: float64
    string_value: str
    bytes_value: sequence[uint8]
    bools: sequence[bool]
    integers: sequence[int64]
    doubles: sequence[float64]
    strings: sequence[str]


@dataclass
class Got(IdlStruct, typename="rcl_interfaces::srv::dds_::GetParameters_Response_"):
    head: Head
    values: sequence[Value]


@dataclass
class Describe(IdlStruct, typename="rcl_interfaces::srv::dds_::DescribeParameters_Request_"):
    head: Head
    names: sequence[str]


@dataclass
class FloatingPointRange(IdlStruct):
    from_value: float64
    to_value: float64
    step: float64


@dataclass
class IntegerRange(IdlStruct):
    from_value: int64
    to_value: int64
    step: uint64


@dataclass
class Descriptor(IdlStruct):
    name: str
    type: uint8
    description: str
    additional_constraints: str
    read_only: bool
    dynamic_typing: bool
    floating_point_range: sequence[FloatingPointRange]
    integer_range: sequence[IntegerRange]


@dataclass
class Described(IdlStruct, typename="rcl_interfaces::srv::dds_::DescribeParameters_Response_"):
    head: Head
    descriptors: sequence[Descriptor]


@dataclass
class Garbage(IdlStruct, typename="rcl_interfaces::srv::dds_::GetParameters_Request_"):
    """Says that far more names follow than do."""

    head: Head
    count: uint32


class Client:
    """One service, asked until it answers."""

    def __init__(self, participant, name, request, reply):
        self.writer = DataWriter(participant, Topic(participant, f"rq{name}Request", request), qos=QOS)
        self.reader = DataReader(participant, Topic(participant, f"rr{name}Reply", reply), qos=QOS)
        self.name, self.request, self.calls = name, request, 0

    def call(self, *words):
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            self.calls += 1
            self.writer.write(self.request(Head(WHO, self.calls), *words))
            again = time.monotonic() + 0.5
            while time.monotonic() < again:
                for reply in self.reader.take(10):
                    if (reply.head.who, reply.head.call) == (WHO, self.calls):
                        return reply
                time.sleep(0.002)
        sys.exit(f"{self.name} does not answer")


def value(one):
    return one.bool_value if one.type == 1 else one.double_value or one.integer_value or one.string_value


def main():
    domain, with_parameters, with_model = sys.argv[1:]
    participant = DomainParticipant(int(domain))
    listing = Client(participant, f"{with_parameters}/list_parameters", List, Listed)
    getting = Client(participant, f"{with_parameters}/get_parameters", Get, Got)
    describing = Client(participant, f"{with_parameters}/describe_parameters", Describe, Described)
    reloading = Client(participant, f"{with_model}/reload_model", Trigger, Triggered)

    names = listing.call().names
    getting.call(names)
    garbage = 1000
    other = DomainParticipant(int(domain))
    spoiler = DataWriter(other, Topic(other, f"rq{with_parameters}/get_parametersRequest", Garbage), qos=QOS)
    while not spoiler.get_matched_subscriptions():
        time.sleep(0.01)
    for _ in range(garbage):
        spoiler.write(Garbage(Head(WHO, 0), 0xFFFFFFF0))
        time.sleep(0.0005)
    values = getting.call(names).values
    described = describing.call(names).descriptors
    triggered = reloading.call()
    print(json.dumps({
        "values": {name: value(one) for name, one in zip(names, values)},
        "read_only": {one.name: one.read_only for one in described},
        "garbage": garbage,
        "trigger": {"success": triggered.success, "message": triggered.message},
    }))


main()

"""A machine and a tracer that are on ROS 2: what a server of I++ DME and a box that writes lines say, published by PyPI `cyclonedds`.

Usage: bridge.py DOMAIN SERVER TRACER OFFSET_Z_MM

Polls SERVER (host:port) for the tip and publishes tip less offset as `sensor_msgs/JointState` on `/cmm/joint_states`; publishes each
length of TRACER, 10 m longer, as `geometry_msgs/PointStamped` of frame `tracer` on `/tracer/point`; and twice a second a
`sensor_msgs/Temperature` of 20.5 on `/hall/air`. Types and protocol are written by hand. Ends when it is killed.
"""

import re
import socket
import sys
import threading
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration

EVERY_S = 0.01
LONGER_M = 10.0


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
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class PointStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PointStamped_"):
    header: Header
    point: Point


@dataclass
class Temperature(IdlStruct, typename="sensor_msgs::msg::dds_::Temperature_"):
    header: Header
    temperature: float64
    variance: float64


def now(frame):
    at = time.time_ns()
    return Header(Time(at // 1_000_000_000, at % 1_000_000_000), frame)


def connect(address):
    host, port = address.rsplit(":", 1)
    return socket.create_connection((host, int(port)))


class Server:
    """A client of I++ DME with nothing of Abbe in it."""

    def __init__(self, address):
        self.stream = connect(address).makefile("rwb", buffering=0)
        self.tag = 0

    def ask(self, command):
        self.tag += 1
        tag = f"{self.tag % 100000:05}"
        self.stream.write(f"{tag} {command}\r\n".encode())
        data = []
        while True:
            line = self.stream.readline().decode().rstrip("\r\n")
            if not line:
                sys.exit("the server ended the connection")
            if not line.startswith(tag):
                continue
            kind = line[6]
            if kind == "!":
                sys.exit(line)
            if kind == "#":
                data.append(line[8:])
            if kind == "%":
                return data


def lengths(address, writer):
    for line in connect(address).makefile("r"):
        cells = line.strip().split(",")
        try:
            metres = float(cells[1]) / 1e3
        except (ValueError, IndexError):
            continue
        writer.write(PointStamped(now("tracer"), Point(metres + LONGER_M, 0.0, 0.0)))


def main(domain, server, tracer, offset_z_mm):
    participant = DomainParticipant(int(domain))
    qos = Qos(
        Policy.Reliability.Reliable(duration(seconds=1)),
        Policy.History.KeepLast(4096),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    )

    def writer(name, kind):
        return DataWriter(participant, Topic(participant, f"rt/{name}", kind, qos=qos), qos=qos)

    axes, points, air = (
        writer("cmm/joint_states", JointState),
        writer("tracer/point", PointStamped),
        writer("hall/air", Temperature),
    )
    while not all(one.get_matched_subscriptions() for one in (axes, points, air)):
        time.sleep(0.05)
    time.sleep(0.5)
    client = Server(server)
    client.ask("StartSession()")
    client.ask("SetCoordSystem(MachineCsy)")
    threading.Thread(target=lengths, args=(tracer, points), daemon=True).start()
    told = 0.0
    while True:
        (line,) = client.ask("Get(X(), Y(), Z())")
        tip = [float(number) for number in re.findall(r"[XYZ]\(([-+0-9.eE]+)\)", line)]
        x, y, z = (mm / 1e3 for mm in (tip[0], tip[1], tip[2] - float(offset_z_mm)))
        axes.write(JointState(now(""), ["z", "x", "y"], [z, x, y], [], []))
        if time.monotonic() - told > 0.5:
            told = time.monotonic()
            air.write(Temperature(now("hall"), 20.5, 0.0))
        time.sleep(EVERY_S)


main(*sys.argv[1:])

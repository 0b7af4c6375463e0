"""A user's programs on a real ROS 2: rclpy on Fast DDS, from the wheels `ros-jazzy-*` of PyPI.

Usage: ros2_user.py streams NAMESPACE COUNT | parameters NODE NAME VALUE | trigger SERVICE
       | clock SECONDS HARDWARE | types TOPIC | nodes NAMESPACE NAME... | scene NAMESPACE | delays NAMESPACE COUNT
       | heard_clock COUNT | machines NAMESPACE... | health NAMESPACE NAME... | services NAMESPACE NAME

streams     subscribes `corrected_point` and `scale/joint_states` with default quality of service (reliable) and
            with that of sensors (best effort) until COUNT messages have come on each.
parameters  lists, gets and describes the parameters of a node, and tries to set one.
trigger     calls a `std_srvs/srv/Trigger`.
clock       publishes SECONDS on /clock, and waits for /diagnostics of HARDWARE with that stamp.
types       what the graph says of a topic: its types, and the publishers with their quality of service.
scene       takes the description of the machine, markers and joint states, as RViz asks for them.
delays      takes COUNT messages of `corrected_point`: their stamps, and when each came.
health      hears /diagnostics until each of these nodes has said how often it publishes.
machines    takes samples of several machines, and says which frames they name.
heard_clock takes COUNT times from /clock.
services    names of a node's services, some seconds after it has published its first `corrected_point`.
nodes       waits until nodes of these names are in a namespace, and gives the parameters of each.

The domain comes from the environment, as for every ROS 2 program. Prints one JSON object. Exits with 1 and a reason
when what it waits for does not come.
"""

import json
import sys
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

PATIENCE_S = 60
SETTLED_S = 3  # in which all endpoints of a node that is there are found
DEFAULT = 10  # what a user writes without a thought: reliable, volatile, keep last 10


def spin_until(node, done, what):
    deadline = time.monotonic() + PATIENCE_S
    while not done():
        rclpy.spin_once(node, timeout_sec=0.05)
        if time.monotonic() > deadline:
            sys.exit(f"{what} did not come within {PATIENCE_S} s")


def answer(node, future, what):
    spin_until(node, future.done, what)
    return future.result()


def stamp_s(header):
    return header.stamp.sec + header.stamp.nanosec * 1e-9


def streams(node, namespace, count):
    taken = {}
    for topic, kind in [("corrected_point", PointStamped), ("scale/joint_states", JointState)]:
        for qos_name, qos in [("default", DEFAULT), ("sensor_data", qos_profile_sensor_data)]:
            messages = taken.setdefault(f"{topic} {qos_name}", [])
            node.create_subscription(kind, f"/{namespace}/{topic}", messages.append, qos)
    spin_until(node, lambda: all(len(messages) >= int(count) for messages in taken.values()), "samples")
    seen = {name: [stamp_s(message.header) for message in messages] for name, messages in taken.items()}
    frames = sorted({message.header.frame_id for messages in taken.values() for message in messages})
    return {"stamps_s": seen, "frames": frames, "now_s": time.time()}


def parameters(node, remote, name, value):
    client = AsyncParameterClient(node, remote)
    if not client.wait_for_services(timeout_sec=PATIENCE_S):
        sys.exit(f"no parameter services of {remote}")
    listed = answer(node, client.list_parameters(), "the list").result.names
    values = answer(node, client.get_parameters(listed), "the values").values
    described = answer(node, client.describe_parameters(listed), "the descriptions").descriptors
    set_to = Parameter(name, value=json.loads(value))
    result = answer(node, client.set_parameters([set_to]), "the result").results[0]
    after = answer(node, client.get_parameters([name]), "the value").values[0]
    return {
        "values": {key: one.bool_value if one.type == 1 else one.double_value or one.integer_value or one.string_value
                   for key, one in zip(listed, values)},
        "read_only": {one.name: one.read_only for one in described},
        "set": {"successful": result.successful, "reason": result.reason},
        "after": after.double_value or after.integer_value or after.string_value,
    }


def trigger(node, service):
    client = node.create_client(Trigger, service)
    if not client.wait_for_service(timeout_sec=PATIENCE_S):
        sys.exit(f"no service {service}")
    reply = answer(node, client.call_async(Trigger.Request()), "the reply")
    return {"success": reply.success, "message": reply.message}


def services(node, namespace, name):
    heard = []
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", heard.append, DEFAULT)
    spin_until(node, lambda: heard, "a sample")
    own = f"/{namespace}/{name}/"
    named = lambda: sorted(found for found, _ in node.get_service_names_and_types() if found.startswith(own))
    spin_until(node, named, "the services")
    settled = time.monotonic() + SETTLED_S
    spin_until(node, lambda: time.monotonic() > settled, "the time")
    return {"services": named()}


def clock(node, seconds, hardware):
    stamps = []

    def hear(array):
        stamps.extend(stamp_s(array.header) for status in array.status if status.hardware_id == hardware)

    node.create_subscription(DiagnosticArray, "/diagnostics", hear, DEFAULT)
    publisher = node.create_publisher(Clock, "/clock", DEFAULT)
    message = Clock()
    message.clock.sec = int(seconds)
    node.create_timer(0.05, lambda: publisher.publish(message))
    spin_until(node, lambda: float(seconds) in stamps, "diagnostics by that clock")
    types = dict(node.get_topic_names_and_types())["/clock"]
    return {"stamps_s": stamps, "types": types}


def types(node, topic):
    found = lambda: node.get_publishers_info_by_topic(topic)
    spin_until(node, found, "a publisher")
    return {
        "types": dict(node.get_topic_names_and_types())[topic],
        "publishers": [
            {"node": one.node_name, "reliability": one.qos_profile.reliability.name, "type_hash": str(one.topic_type_hash)}
            for one in found()
        ],
    }


def nodes(node, namespace, *names):
    seen = lambda: {name for name, space in node.get_node_names_and_namespaces() if space == f"/{namespace}"}
    spin_until(node, lambda: set(names) <= seen(), "the nodes")
    listed = {}
    for name in names:
        client = AsyncParameterClient(node, f"/{namespace}/{name}")
        if not client.wait_for_services(timeout_sec=PATIENCE_S):
            sys.exit(f"no parameter services of {name}")
        listed[name] = sorted(answer(node, client.list_parameters(), "the parameters").result.names)
    return {"parameters": listed, "seen": sorted(seen())}


def scene(node, namespace):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    texts, arrays, joints = [], [], []
    node.create_subscription(MarkerArray, f"/{namespace}/markers", arrays.append, DEFAULT)
    node.create_subscription(JointState, f"/{namespace}/scale/joint_states", joints.append, DEFAULT)
    spin_until(node, lambda: arrays and joints, "markers and joint states")
    # Only now, long after it was published.
    node.create_subscription(String, f"/{namespace}/robot_description", texts.append, latched)
    spin_until(node, lambda: texts, "the description")
    shape = lambda one: {
        "ns": one.ns, "id": one.id, "type": one.type, "action": one.action, "frame": one.header.frame_id,
        "stamp_s": stamp_s(one.header), "text": one.text, "points": [[p.x, p.y, p.z] for p in one.points],
        "scale": [one.scale.x, one.scale.y, one.scale.z], "alpha": one.color.a,
    }
    return {"description": texts[0].data, "joints": list(joints[0].name),
            "markers": [[shape(one) for one in array.markers] for array in arrays]}


def health(node, namespace, *names):
    heard = {}

    def hear(array):
        for one in array.status:
            heard[one.name] = {
                "level": one.level[0], "message": one.message, "hardware": one.hardware_id,
                "values": {value.key: value.value for value in one.values},
                "stamp_s": stamp_s(array.header),
            }

    node.create_subscription(DiagnosticArray, "/diagnostics", hear, DEFAULT)
    wanted = {f"{namespace}/{name}: Frequency Status" for name in names}
    spin_until(node, lambda: wanted <= set(heard), "how often these nodes publish")
    return heard


def machines(node, *namespaces):
    seen = {name: [] for name in namespaces}
    for name in namespaces:
        node.create_subscription(JointState, f"/{name}/scale/joint_states", seen[name].append, DEFAULT)
        node.create_subscription(PointStamped, f"/{name}/corrected_point", seen[name].append, DEFAULT)
    both = lambda found: {type(one).__name__ for one in found} == {"JointState", "PointStamped"}
    spin_until(node, lambda: all(both(found) and len(found) >= 100 for found in seen.values()), "samples of all machines")
    return {name: sorted({one.header.frame_id for one in found}) for name, found in seen.items()}


def delays(node, namespace, count):
    came = []
    hear = lambda message: came.append((stamp_s(message.header), time.time()))
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", hear, DEFAULT)
    spin_until(node, lambda: len(came) >= int(count), "samples")
    return {"stamps_s": [stamp for stamp, _ in came], "came_s": [at for _, at in came]}


def heard_clock(node, count):
    heard = []
    node.create_subscription(Clock, "/clock", lambda one: heard.append(one.clock.sec + one.clock.nanosec * 1e-9), DEFAULT)
    spin_until(node, lambda: len(heard) >= int(count), "times")
    return {"heard_s": heard, "types": dict(node.get_topic_names_and_types())["/clock"]}


def main():
    task, *words = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node("a_users_program")
    print(json.dumps({"streams": streams, "parameters": parameters, "trigger": trigger, "clock": clock,
                      "types": types, "nodes": nodes, "scene": scene, "delays": delays,
                      "heard_clock": heard_clock, "machines": machines, "health": health,
                      "services": services}[task](node, *words)))


main()

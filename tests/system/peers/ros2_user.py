"""A user's programs on a real ROS 2: rclpy on Fast DDS, from the wheels `ros-jazzy-*` of PyPI.

Usage: ros2_user.py streams NAMESPACE COUNT | parameters NODE NAME VALUE | trigger SERVICE
       | clock SECONDS HARDWARE | offers TOPIC... | plays PROFILE | nodes NAMESPACE NAME... | scene NAMESPACE | delays NAMESPACE COUNT
       | heard_clock COUNT | machines NAMESPACE... | health NAMESPACE NAME... | manage NAMESPACE ASIDE MODEL
       | change NAMESPACE MODEL | files NAMESPACE NODE NAME FILE... | log NAMESPACE NODE PART | services NAMESPACE NAME... | strangers
       | corrected NAMESPACE COUNT | residuals NAMESPACE COUNT | quarrel NODE COUNT | press NODE LAUNCH_FILE
       | echo FROM TO | round_trip NAMESPACE FROM TO X Y Z COUNT | describe NODE OTHER TYPE...

streams     subscribes `corrected_point` and `scale/joint_states` with default quality of service (reliable) and
            with that of sensors (best effort) until COUNT messages have come on each.
parameters  lists, gets and describes the parameters of a node, and tries to set one.
trigger     calls a `std_srvs/srv/Trigger`.
clock       publishes SECONDS on /clock, and waits for /diagnostics of HARDWARE with that stamp.
offers      what the graph says of topics: the quality of service of each publisher.
plays       offers a topic as a bag says (PROFILE, the YAML of one topic), until subscribers with default quality of service and
            with that of sensors have taken some.
scene       takes the description of the machine, markers and joint states, as RViz asks for them.
delays      takes COUNT messages of `corrected_point`: their stamps, and when each came.
health      hears /diagnostics until each of these nodes has said how often it publishes.
machines    takes samples of several machines, and says which frames they name.
heard_clock takes COUNT times from /clock.
manage      takes the nodes of a graph through their states, as `ros2 lifecycle` does; ASIDE becomes MODEL on the way.
change      sets parameters of running nodes, those that may change and those that may not; MODEL becomes the model file.
files       sets a parameter of a running node to one FILE after the other, with corrected points before each and after the last.
log         hears /rosout until a node says PART, long after it did.
services    names of the services of nodes, some seconds after the first `corrected_point` has come.
corrected   takes COUNT `abbe_msgs/CorrectedCoordinates` with the classes that rosidl made of the .msg file; a double comes as
            the whole number of its bits, bytes come in hex.
residuals   the same with `abbe_msgs/RangeResidual`.
quarrel     deactivates and activates a node COUNT times, whatever others do with it, and hears what it does.
press       floods a node with calls, then stops its process and its gateway's (SIGSTOP, SIGCONT) while it commands it.
kill        gives a node another MODEL, deactivates it, kills its process (SIGKILL), and asks the next one how it stands.
echo        answers each `sensor_msgs/JointState` of FROM with a point of the same stamp on TO, until its standard input ends.
round_trip  sends positions at 1 kHz, by turns to `axes` of a graph and to an echo: COUNT each, and how long each took back.
describe    asks a node what each TYPE is made of: without a hash, with that of the description, and with a wrong one; and what
            OTHER is, which the node has not. Hashes are computed by ROS 2's own generator of them.
strangers   looks for nodes until its standard input ends, and SETTLED_S at least.
nodes       waits until nodes of these names are in a namespace, and gives the parameters of each.

The domain comes from the environment, as for every ROS 2 program. Prints one JSON object. Exits with 1 and a reason
when what it waits for does not come.
"""

import json
import os
import select
import signal
import struct
import sys
import time

import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import (DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy, qos_profile_parameter_events,
                       qos_profile_sensor_data)
from rosgraph_msgs.msg import Clock
from rosidl_generator_type_description import calculate_type_hash
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from type_description_interfaces.srv import GetTypeDescription
from visualization_msgs.msg import MarkerArray

PATIENCE_S = 60
JOINS_AFTER_S = 2
SETTLED_S = 3  # in which all endpoints of a node that is there are found
DEFAULT = 10  # what a user writes without a thought: reliable, volatile, keep last 10
DEEP = 1000  # a second at 1 kHz


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


def services(node, namespace, *names):
    heard = []
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", heard.append, DEFAULT)
    spin_until(node, lambda: heard, "a sample")

    def own(name):
        begins = f"/{namespace}/{name}/"
        return sorted(one[len(begins):] for one, _ in node.get_service_names_and_types() if one.startswith(begins))

    spin_until(node, lambda: all(own(name) for name in names), "the services")
    settled = time.monotonic() + SETTLED_S
    spin_until(node, lambda: time.monotonic() > settled, "the time")
    return {name: own(name) for name in names}


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


def offers(node, *topics):
    found = lambda topic: [one.qos_profile for one in node.get_publishers_info_by_topic(topic)]
    spin_until(node, lambda: all(found(topic) for topic in topics), "a publisher of each topic")
    return {topic: [[one.reliability.name, one.durability.name] for one in found(topic)] for topic in topics}


def plays(node, profile):
    (recorded,) = yaml.safe_load(profile)
    qos = QoSProfile(history=HistoryPolicy(recorded["history"]), depth=recorded["depth"],
                     reliability=ReliabilityPolicy(recorded["reliability"]),
                     durability=DurabilityPolicy(recorded["durability"]))
    taken = {"default": [], "sensor_data": []}
    for name, asked in [("default", DEFAULT), ("sensor_data", qos_profile_sensor_data)]:
        node.create_subscription(PointStamped, "played", taken[name].append, asked)
    publisher = node.create_publisher(PointStamped, "played", qos)
    node.create_timer(0.02, lambda: publisher.publish(PointStamped()))
    spin_until(node, lambda: all(len(messages) >= 10 for messages in taken.values()), "what subscribers of either kind ask for")
    return {"offered": [qos.reliability.name, qos.durability.name]}


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


class Managed:
    """A managed node, as a manager sees it."""

    def __init__(self, node, remote):
        self.node, self.remote = node, remote
        self.clients = {
            name: node.create_client(kind, f"{remote}/{name}")
            for name, kind in [("change_state", ChangeState), ("get_state", GetState),
                               ("get_available_states", GetAvailableStates),
                               ("get_available_transitions", GetAvailableTransitions),
                               ("get_transition_graph", GetAvailableTransitions)]
        }

    def call(self, name, request):
        client = self.clients[name]
        if not client.wait_for_service(timeout_sec=PATIENCE_S):
            sys.exit(f"no service {self.remote}/{name}")
        return answer(self.node, client.call_async(request), f"the reply of {self.remote}/{name}")

    def change(self, transition):
        return self.call("change_state", ChangeState.Request(transition=Transition(id=transition))).success

    def state(self):
        return self.call("get_state", GetState.Request()).current_state.label

    def available(self):
        found = self.call("get_available_transitions", GetAvailableTransitions.Request()).available_transitions
        return sorted(one.transition.label for one in found)


def manage(node, namespace, aside, model):
    points, events, health = [], [], []
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", points.append, DEFAULT)
    node.create_subscription(TransitionEvent, f"/{namespace}/geometric/transition_event", events.append, DEFAULT)
    hear = lambda array: health.extend(one for one in array.status if one.name == f"{namespace}/geometric: lifecycle")
    node.create_subscription(DiagnosticArray, "/diagnostics", hear, DEFAULT)
    nodes = {name: Managed(node, f"/{namespace}/{name}") for name in ["recorder", "residual", "geometric", "scale"]}
    geometric, said = nodes["geometric"], {}
    said["at first"] = {name: one.state() for name, one in nodes.items()}
    said["available at first"] = geometric.available()
    said["states"] = len(geometric.call("get_available_states", GetAvailableStates.Request()).available_states)
    graph = geometric.call("get_transition_graph", GetAvailableTransitions.Request()).available_transitions
    said["steps"] = len(graph)
    said["activated too early"] = geometric.change(Transition.TRANSITION_ACTIVATE)
    said["configured without a file"] = geometric.change(Transition.TRANSITION_CONFIGURE)
    said["state without a file"] = geometric.state()
    spin_until(node, lambda: any("could not be" in one.message for one in health), "the reason")
    said["reason"] = next(one.message for one in health if "could not be" in one.message)
    os.rename(aside, model)
    for transition in [Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE]:
        said[f"all {transition}"] = [one.change(transition) for one in nodes.values()]
    said["at work"] = {name: one.state() for name, one in nodes.items()}

    def come(count):
        before = len(points)
        spin_until(node, lambda: len(points) >= before + count, "corrected points")

    def pause_s(seconds):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            rclpy.spin_once(node, timeout_sec=0.02)

    come(200)
    said["paused"] = geometric.change(Transition.TRANSITION_DEACTIVATE)
    pause_s(0.5)
    before = len(points)
    pause_s(0.5)
    said["points while inactive"] = len(points) - before
    said["resumed"] = geometric.change(Transition.TRANSITION_ACTIVATE)
    come(200)
    residual = nodes["residual"]
    said["residual paused"] = residual.change(Transition.TRANSITION_DEACTIVATE)
    pause_s(0.3)
    said["residual resumed"] = residual.change(Transition.TRANSITION_ACTIVATE)
    come(200)
    said["cleaned up while active"] = geometric.change(Transition.TRANSITION_CLEANUP)
    said["by label"] = geometric.call("change_state", ChangeState.Request(transition=Transition(label="deactivate"))).success
    said["cleaned up"] = geometric.change(Transition.TRANSITION_CLEANUP)
    said["after cleaning"] = geometric.state()
    recorder = nodes["recorder"]
    said["recorder again"] = [recorder.change(one) for one in [
        Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP,
        Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE]]
    said["again"] = [geometric.change(Transition.TRANSITION_CONFIGURE), geometric.change(Transition.TRANSITION_ACTIVATE)]
    come(200)
    said["shut down"] = [geometric.change(Transition.TRANSITION_ACTIVE_SHUTDOWN), geometric.state()]
    said["events"] = [[one.start_state.label, one.transition.label, one.goal_state.label] for one in events]
    said["ages_s"] = [time.time() - one.timestamp * 1e-9 for one in events]
    return said


def change(node, namespace, model):
    points, events, clients, said = [], [], {}, {}
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", points.append, DEFAULT)
    node.create_subscription(ParameterEvent, "/parameter_events", events.append, qos_profile_parameter_events)
    for name in ["geometric", "monitor"]:
        clients[name] = AsyncParameterClient(node, f"/{namespace}/{name}")
        if not clients[name].wait_for_services(timeout_sec=PATIENCE_S):
            sys.exit(f"no parameter services of {name}")
    value = lambda one: one.double_value or one.integer_value or one.string_value

    def come(count):
        before = len(points)
        spin_until(node, lambda: len(points) >= before + count, "corrected points")

    def set_to(name, atomically=False, **values):
        parameters = [Parameter(key, value=one) for key, one in values.items()]
        client = clients[name]
        if atomically:
            results = [answer(node, client.set_parameters_atomically(parameters), "the result").result]
        else:
            results = answer(node, client.set_parameters(parameters), "the results").results
        return [[one.successful, one.reason] for one in results]

    come(200)
    for name in clients:
        listed = answer(node, clients[name].list_parameters(), "the list").result.names
        described = answer(node, clients[name].describe_parameters(listed), "the descriptions").descriptors
        said[f"changeable of {name}"] = sorted(one.name for one in described if not one.read_only)
    said["no such file"] = set_to("geometric", model="nowhere.json")
    os.mkfifo(f"{model}.pipe")
    said["pipe"] = set_to("geometric", model=f"{model}.pipe")
    said["no age"] = set_to("geometric", max_covariate_age_s=-1.0)
    said["age"] = set_to("geometric", max_covariate_age_s=1.5)
    said["model"] = set_to("geometric", model=model)
    come(200)
    said["one of two"] = set_to("monitor", window=0, single_bound=5.0)
    said["none of two"] = set_to("monitor", atomically=True, single_bound=6.0, window=-1)
    said["both"] = set_to("monitor", atomically=True, single_bound=7.0, window=50)
    for name, keys in [("geometric", ["model", "max_covariate_age_s"]), ("monitor", ["single_bound", "window"])]:
        values = answer(node, clients[name].get_parameters(keys), "the values").values
        said[f"values of {name}"] = [value(one) for one in values]
    changed = lambda: [[event.node, one.name, value(one.value)] for event in events for one in event.changed_parameters]
    spin_until(node, lambda: any(name == "window" for _, name, _ in changed()), "the event")
    said["events"] = changed()
    # Who joins later hears of nothing old, whatever it asks for.
    late = []
    latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(ParameterEvent, "/parameter_events", late.append, latched)
    node.create_subscription(ParameterEvent, "/parameter_events", late.append, qos_profile_parameter_events)
    come(1000)
    said["old events"] = len([one for one in late if one.node.startswith(f"/{namespace}/")])
    return said


def files(node, namespace, name, parameter, *values):
    points, client, results = [], AsyncParameterClient(node, f"/{namespace}/{name}"), []
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", points.append, DEFAULT)
    if not client.wait_for_services(timeout_sec=PATIENCE_S):
        sys.exit(f"no parameter services of {name}")

    def come(count):
        before = len(points)
        spin_until(node, lambda: len(points) >= before + count, "corrected points")

    for value in values:
        come(200)
        (result,) = answer(node, client.set_parameters([Parameter(parameter, value=value)]), "the result").results
        (after,) = answer(node, client.get_parameters([parameter]), "the value").values
        results.append([result.successful, result.reason, after.string_value])
    come(200)
    return {"results": results}


def log(node, namespace, name, part):
    lines = []
    seen = lambda: (name, f"/{namespace}") in node.get_node_names_and_namespaces()
    spin_until(node, seen, "the node")
    time.sleep(1.0)
    node.create_subscription(Log, "/rosout", lines.append, QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    spin_until(node, lambda: any(part in line.msg for line in lines), "the line")
    found = next(line for line in lines if part in line.msg)
    return {"name": found.name, "level": found.level, "file": found.file, "line": found.line, "text": found.msg,
            "age_s": time.time() - found.stamp.sec - found.stamp.nanosec * 1e-9,
            "names": sorted({line.name for line in lines})}


def strangers(node):
    settled = time.monotonic() + SETTLED_S
    while time.monotonic() < settled or not select.select([sys.stdin], [], [], 0)[0]:
        rclpy.spin_once(node, timeout_sec=0.05)
    return {"nodes": sorted({f"{space.rstrip('/')}/{name}" for name, space in node.get_node_names_and_namespaces()})}


def quarrel(node, remote, count):
    events = []
    node.create_subscription(TransitionEvent, f"{remote}/transition_event", events.append, 1000)
    managed, outcomes = Managed(node, remote), []
    for _ in range(int(count)):
        for transition in [Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE]:
            outcomes.append(managed.change(transition))
    return {"outcomes": outcomes,
            "events": [[one.start_state.label, one.transition.label, one.goal_state.label] for one in events]}


def echo(node, source, target):
    publisher = node.create_publisher(PointStamped, target, DEEP)
    node.create_subscription(JointState, source, lambda one: publisher.publish(PointStamped(header=one.header)), DEEP)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not select.select([sys.stdin], [], [], 0)[0]:
        executor.spin_once(timeout_sec=0.1)
    return {}


def round_trip(node, namespace, source, target, x, y, z, count):
    ways = {"corrected": (f"/{namespace}/axes", f"/{namespace}/corrected_point"), "echo": (source, target)}
    sent, came, publishers = {way: {} for way in ways}, {way: {} for way in ways}, {}
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    for way, (there, back) in ways.items():
        publishers[way] = node.create_publisher(JointState, there, DEEP)
        hear = lambda one, way=way: came[way].setdefault((one.header.stamp.sec, one.header.stamp.nanosec), time.monotonic())
        node.create_subscription(PointStamped, back, hear, DEEP)
    message = JointState(name=["x", "y", "z"], position=[float(x), float(y), float(z)])

    def send(way):
        now_ns = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now_ns, 10**9)
        sent[way][divmod(now_ns, 10**9)] = time.monotonic()
        publishers[way].publish(message)

    deadline = time.monotonic() + PATIENCE_S
    while not all(came.values()):
        for way in ways:
            send(way)
        executor.spin_once(timeout_sec=0.05)
        if time.monotonic() > deadline:
            sys.exit(f"only {[way for way in ways if came[way]]} answered within {PATIENCE_S} s")
    settled = time.monotonic() + 1.0
    while time.monotonic() < settled:
        executor.spin_once(timeout_sec=0.05)
    for way in ways:
        sent[way].clear()
    turns = 4
    for turn in range(turns):
        for way in ways if turn % 2 == 0 else reversed(ways):
            due = time.monotonic()
            for _ in range(int(count) // turns):
                send(way)
                due += 0.001
                while (left := due - time.monotonic()) > 0:
                    executor.spin_once(timeout_sec=left)
    settled = time.monotonic() + 10.0
    while time.monotonic() < settled and not all(sent[way].keys() <= came[way].keys() for way in ways):
        executor.spin_once(timeout_sec=0.05)

    def figures(way):
        took_ms = sorted(1e3 * (came[way][stamp] - at) for stamp, at in sent[way].items() if stamp in came[way])
        at = lambda share: took_ms[min(int(share * len(took_ms)), len(took_ms) - 1)]
        return {"sent": len(sent[way]), "came": len(took_ms), "p50_ms": at(0.5), "p99_ms": at(0.99), "max_ms": took_ms[-1]}

    return {way: figures(way) for way in ways}


def plain(value):
    """A message as dictionaries and lists, fields in the order of its file."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    return [plain(one) for one in value] if isinstance(value, (list, tuple)) else value


def describe(node, remote, other, *kinds):
    client = node.create_client(GetTypeDescription, f"{remote}/get_type_description")
    if not client.wait_for_service(timeout_sec=PATIENCE_S):
        sys.exit(f"{remote} describes no types")

    def asked(type_name, type_hash, sources):
        request = GetTypeDescription.Request(type_name=type_name, type_hash=type_hash, include_type_sources=sources)
        reply = answer(node, client.call_async(request), "the description")
        if not reply.successful:
            return {"reason": reply.failure_reason}
        return {"hash": calculate_type_hash(plain(reply.type_description)),
                "fields": [field.name for field in reply.type_description.type_description.fields],
                "sources": {source.type_name: [source.encoding, source.raw_file_contents] for source in reply.type_sources}}

    said = {"other": asked(other, "", False)}
    for kind in kinds:
        first = asked(kind, "", True)
        wrong = first["hash"][:-1] + ("1" if first["hash"][-1] == "0" else "0")
        said[kind] = {"first": first, "by hash": asked(kind, first["hash"], False), "wrong hash": asked(kind, wrong, False)}
    return said


def process_of(name, launch_file):
    for process in filter(str.isdigit, os.listdir("/proc")):
        try:
            words = open(f"/proc/{process}/cmdline").read().split("\0")
        except OSError:
            continue
        if "node" in words and name in words and launch_file in words:
            return int(process)
    sys.exit(f"no process of {name}")


def children_of(process):
    threads = os.listdir(f"/proc/{process}/task")
    return [int(one) for thread in threads for one in open(f"/proc/{process}/task/{thread}/children").read().split()]


def press(node, remote, launch_file):
    managed, said, pending = Managed(node, remote), {}, []
    managed.change(Transition.TRANSITION_ACTIVATE)
    said["at first"] = managed.state()
    until = time.monotonic() + 2.0
    while time.monotonic() < until:
        for name, request in [("get_state", GetState.Request()), ("get_available_states", GetAvailableStates.Request())]:
            pending += [managed.clients[name].call_async(request) for _ in range(10)]
        rclpy.spin_once(node, timeout_sec=0)
    said["asked"] = len(pending)
    said["after the flood"] = managed.state()
    said["answered"] = sum(future.done() for future in pending)

    process = process_of(remote.rsplit("/", 1)[1], launch_file)
    os.kill(process, signal.SIGSTOP)
    try:
        said["while it stands"] = managed.state()
        change = managed.clients["change_state"].call_async(
            ChangeState.Request(transition=Transition(id=Transition.TRANSITION_DEACTIVATE)))
        until = time.monotonic() + 0.5
        while time.monotonic() < until:
            rclpy.spin_once(node, timeout_sec=0.05)
        said["answered while it stands"] = change.done()
    finally:
        os.kill(process, signal.SIGCONT)
    said["answered when it goes on"] = answer(node, change, "the reply of a node that goes on").success
    said["then"] = managed.state()

    gateways = children_of(process)
    said["gateways"] = len(gateways)
    os.kill(gateways[0], signal.SIGSTOP)
    time.sleep(0.2)
    os.kill(gateways[0], signal.SIGCONT)
    spin_until(node, lambda: children_of(process) not in ([], gateways), "another gateway")

    def state():
        # What the old gateway was asked is answered by nobody.
        future = managed.clients["get_state"].call_async(GetState.Request())
        until = time.monotonic() + 1.0
        while not future.done() and time.monotonic() < until:
            rclpy.spin_once(node, timeout_sec=0.05)
        return future.done() and future.result().current_state.label

    found = []
    spin_until(node, lambda: found.append(state()) or found[-1], "an answer of the next gateway")
    said["of the next gateway"] = found[-1]
    said["activated"] = managed.change(Transition.TRANSITION_ACTIVATE)
    said["at last"] = managed.state()
    return said


def bits(value):
    """A field of a message without loss: numbers as they are, doubles by their bits, bytes in hex, messages by their fields."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: bits(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, float):
        return struct.unpack("<Q", struct.pack("<d", value))[0]
    if isinstance(value, (bool, int, str)):
        return value
    if value.dtype == "uint8":
        return value.tobytes().hex()
    return [bits(one) for one in value.tolist()]


def corrected(node, namespace, count):
    from abbe_msgs.msg import CorrectedCoordinates

    taken = []
    node.create_subscription(CorrectedCoordinates, f"/{namespace}/corrected", taken.append, DEFAULT)
    spin_until(node, lambda: len(taken) >= int(count), "samples")
    return {"taken": [bits(one) for one in taken], "covers": CorrectedCoordinates.STATUS_INACTIVE}


def residuals(node, namespace, count):
    from abbe_msgs.msg import RangeResidual

    taken = []
    node.create_subscription(RangeResidual, f"/{namespace}/monitor/range_residual", taken.append, DEFAULT)
    spin_until(node, lambda: len(taken) >= int(count), "residuals")
    return {"taken": [bits(one) for one in taken]}


def kill(node, remote, launch_file, model):
    managed, said, name = Managed(node, remote), {}, remote.rsplit("/", 1)[1]
    client = AsyncParameterClient(node, remote)
    if not client.wait_for_services(timeout_sec=PATIENCE_S):
        sys.exit(f"no parameter services of {name}")
    said["set"] = answer(node, client.set_parameters([Parameter("model", value=model)]), "the result").results[0].successful
    said["deactivated"] = managed.change(Transition.TRANSITION_DEACTIVATE)
    process = process_of(name, launch_file)
    gateways = children_of(process)
    os.kill(process, signal.SIGKILL)

    def comes_again():
        try:
            another = process_of(name, launch_file) != process
        except SystemExit:
            return False
        # What the old gateway says is of the old process.
        return another and not any(os.path.exists(f"/proc/{one}") for one in gateways)

    spin_until(node, comes_again, "another process without the old gateway")

    def asked(ask):
        # A call that comes before the new services are known is answered by nobody.
        found = []

        def once():
            future, until = ask(), time.monotonic() + 1.0
            while not future.done() and time.monotonic() < until:
                rclpy.spin_once(node, timeout_sec=0.05)
            found.append(future.result() if future.done() else None)
            return found[-1] is not None

        spin_until(node, once, "an answer of the next process")
        return found[-1]

    def state():
        return asked(lambda: managed.clients["get_state"].call_async(GetState.Request())).current_state.label

    spin_until(node, lambda: state() != "unconfigured", "a node that is configured")
    said["state"] = state()
    said["model"] = asked(lambda: client.get_parameters(["model"])).values[0].string_value
    said["activated"] = asked(lambda: managed.clients["change_state"].call_async(
        ChangeState.Request(transition=Transition(id=Transition.TRANSITION_ACTIVATE)))).success
    points = []
    node.create_subscription(PointStamped, "/" + remote.split("/")[1] + "/corrected_point", points.append, DEFAULT)
    spin_until(node, lambda: len(points) > 200, "corrected points")
    return said


def main():
    task, *words = sys.argv[1:]
    # A graph that is started beside it has announced its endpoints by then: Fast DDS loses some of those that come while it joins, as
    # nodes/runtime/src/ros/matched.rs says.
    time.sleep(JOINS_AFTER_S)
    rclpy.init()
    node = rclpy.create_node("a_users_program")
    print(json.dumps({"streams": streams, "parameters": parameters, "trigger": trigger, "clock": clock,
                      "offers": offers, "plays": plays, "nodes": nodes, "scene": scene, "delays": delays,
                      "heard_clock": heard_clock, "machines": machines, "health": health,
                      "manage": manage, "change": change, "files": files, "log": log, "services": services,
                      "strangers": strangers, "corrected": corrected, "residuals": residuals, "quarrel": quarrel,
                      "press": press, "kill": kill, "echo": echo, "round_trip": round_trip, "describe": describe}[task](node, *words)))


if __name__ == "__main__":
    main()

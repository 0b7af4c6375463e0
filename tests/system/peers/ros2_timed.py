"""A user's programs on a real ROS 2 whose time is what is looked at: rclpy on Fast DDS, as ros2_user.py.

Usage: ros2_timed.py first NAMESPACE THERE X Y Z COUNT | hears NAMESPACE THERE COUNT | sim_time NAMESPACE START LEAP | arrivals NAMESPACE START X Y Z
       | follows NAMESPACE COUNT | held NAMESPACE

first     a controller that is there before the graph: writes the file THERE when it is, waits for a subscriber of its positions and
          sends COUNT of them at once, one a millisecond. Which of the corrected points came back.
hears     a subscriber that is there before the graph, as above: the stamps (s) of the first COUNT corrected points that come.
sim_time  is the time of a graph: from START (s) at a quarter of the host's pace, then it stands, then it leaps by LEAP (s) and goes on,
          until what it leapt over has come, then it is set back. The corrected points of each part, and what the scale node says of
          its frequency.
arrivals  sends temperatures without a stamp, and positions of half a second after START, before there is a time on /clock and while
          that is START: how many corrected points came.
follows   a node with use_sim_time beside a graph that publishes the clock of its recording: COUNT corrected points, and what time it was.
held      subscribes points and diagnostics, says so when they come, and takes them until it is ended.

The domain comes from the environment. Prints one JSON object, in its last line.
"""

import json
import pathlib
import sys
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from ros2_user import DEEP, DEFAULT, JOINS_AFTER_S, PATIENCE_S, spin_until, stamp_s
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

PACE = 0.25  # of simulated time, beside the host's
TICK_S = 0.01
ON_TIME_S = 1.0  # four seconds of the host's


def be_there(executor, there):
    until = time.monotonic() + 1.0
    while time.monotonic() < until:
        executor.spin_once(timeout_sec=0.05)
    pathlib.Path(there).touch()


def hears(node, namespace, there, count):
    points = []
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", points.append, DEEP)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    be_there(executor, there)
    until = time.monotonic() + PATIENCE_S
    while len(points) < int(count):
        executor.spin_once(timeout_sec=0.1)
        if time.monotonic() > until:
            sys.exit(f"{len(points)} points came within {PATIENCE_S} s")
    return {"stamps_s": [stamp_s(point.header) for point in points]}


def first(node, namespace, there, x, y, z, count):
    came = {}
    hear = lambda point: came.setdefault(point.header.stamp.nanosec, True)
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", hear, DEEP)
    publisher = node.create_publisher(JointState, f"/{namespace}/axes", DEEP)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    be_there(executor, there)
    until = time.monotonic() + PATIENCE_S
    while not publisher.get_subscription_count():
        executor.spin_once(timeout_sec=0.001)
        if time.monotonic() > until:
            sys.exit(f"nobody subscribed the positions within {PATIENCE_S} s")
    message = JointState(name=["x", "y", "z"], position=[float(x), float(y), float(z)])
    message.header.stamp.sec = int(time.time())
    due = time.monotonic()
    for number in range(int(count)):
        message.header.stamp.nanosec = number + 1
        publisher.publish(message)
        due += 0.001
        while (left := due - time.monotonic()) > 0:
            executor.spin_once(timeout_sec=left)
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and len(came) < int(count):
        executor.spin_once(timeout_sec=0.05)
    return {"missing": [number for number in range(int(count)) if number + 1 not in came]}


def sim_time(node, namespace, start, leap):
    points, reports, part, now = [], [], ["starting"], [float(start)]
    hear = lambda point: points.append([part[0], stamp_s(point.header), now[0]])

    def hear_report(array):
        for one in array.status:
            if one.name.startswith(f"{namespace}/"):
                reports.append([part[0], one.name, one.level[0], one.message, stamp_s(array.header)])

    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", hear, DEEP)
    node.create_subscription(DiagnosticArray, "/diagnostics", hear_report, DEEP)
    publisher = node.create_publisher(Clock, "/clock", DEFAULT)
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def run(seconds, pace):
        began, from_s = time.monotonic(), now[0]
        tick = began
        while tick < began + seconds:
            now[0] = from_s + pace * (tick - began)
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(round(now[0] * 1e9), 10**9)
            publisher.publish(message)
            tick += TICK_S
            while (left := tick - time.monotonic()) > 0:
                executor.spin_once(timeout_sec=left)

    def run_until(done, problem):
        until = time.monotonic() + PATIENCE_S
        while not done():
            if time.monotonic() > until:
                sys.exit(problem)
            run(0.2, PACE)

    def is_calm():
        before = len(points)
        run(1.0, PACE)
        return len(points) == before

    run_until(lambda: points, "no corrected point came by this clock")
    # What ran up while the graph started, and the first windows of frequencies, are over.
    run(8.0, PACE)
    part[0] = "slow"
    from_s = now[0]
    run(4.0, PACE)
    slow_s = now[0] - from_s
    part[0] = "standing still"
    run(1.0, 0.0)
    part[0] = "stands"
    run(7.0, 0.0)
    now[0] += float(leap)
    part[0] = "leapt"
    run_until(lambda: now[0] - points[-1][1] < ON_TIME_S, "the points of what was leapt over did not all come")
    leapt_to_s = now[0]
    now[0] -= float(leap)
    part[0] = "going back"
    # What was on its way.
    run_until(is_calm, "points still come after time was set back")
    part[0] = "set back"
    run(2.0, PACE)
    return {"points": points, "reports": reports, "slow_s": slow_s, "leapt_to_s": leapt_to_s}


def arrivals(node, namespace, start, x, y, z):
    points = []
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", points.append, DEEP)
    positions = node.create_publisher(JointState, f"/{namespace}/axes", DEEP)
    temperatures = node.create_publisher(Float64, "/air", DEEP)
    clock = node.create_publisher(Clock, "/clock", DEFAULT)
    message = JointState(name=["x", "y", "z"], position=[float(x), float(y), float(z)])
    message.header.stamp.sec, message.header.stamp.nanosec = int(float(start)), 10**9 // 2
    has_both = lambda: positions.get_subscription_count() and temperatures.get_subscription_count()
    spin_until(node, has_both, "a subscriber of positions and one of temperatures")

    def send(seconds, shown_s):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            if shown_s is not None:
                told = Clock()
                told.clock.sec = int(shown_s)
                clock.publish(told)
            temperatures.publish(Float64(data=20.5))
            positions.publish(message)
            rclpy.spin_once(node, timeout_sec=0.01)

    spin_until(node, lambda: send(0.5, None) or len(points) > 10, "corrected points without a clock")
    before = len(points)
    spin_until(node, lambda: send(0.5, float(start)) or len(points) > before + 100, "corrected points by this clock")
    return {"points": len(points)}


def follows(_, namespace, count):
    node = rclpy.create_node("goes_by_the_clock", parameter_overrides=[Parameter("use_sim_time", value=True)])
    heard, ticks = [], []
    now_s = lambda: node.get_clock().now().nanoseconds * 1e-9
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", lambda one: heard.append([stamp_s(one.header), now_s()]), DEEP)
    node.create_timer(0.1, lambda: ticks.append(now_s()))
    spin_until(node, lambda: len(heard) >= int(count) and len(ticks) >= 10, "points and ticks of a timer of simulated time")
    return {"is_active": node.get_clock().ros_time_is_active, "heard_s": heard, "ticks_s": ticks}


def held(node, namespace):
    points, reports = [], []
    node.create_subscription(PointStamped, f"/{namespace}/corrected_point", points.append, DEFAULT)
    node.create_subscription(DiagnosticArray, "/diagnostics", reports.append, DEFAULT)
    spin_until(node, lambda: len(points) > 100 and reports, "points and diagnostics")
    print(json.dumps({"held": True}), flush=True)
    while True:
        rclpy.spin_once(node, timeout_sec=0.1)
        points.clear()
        reports.clear()


def main():
    task, *words = sys.argv[1:]
    # As ros2_user.py does, and for its reason; but who is there first does not wait for who comes later.
    if task not in ["first", "hears"]:
        time.sleep(JOINS_AFTER_S)
    rclpy.init()
    node = rclpy.create_node("a_timed_program")
    tasks = {"first": first, "hears": hears, "sim_time": sim_time, "arrivals": arrivals, "follows": follows, "held": held}
    print(json.dumps(tasks[task](node, *words)))


main()

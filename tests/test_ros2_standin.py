"""The stand-in `ros2` command prints what Jazzy's ros2cli prints.

The expected texts were compared with ros2cli 0.32; where a genuine `ros2` is on PATH, it has to
pass the same tests.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

ROOT = Path(__file__).resolve().parents[1]
STAND_IN = ROOT / "scripts/ros2/bin/ros2"
DOMAIN = str(1 + os.getpid() % 100)
Results = dict[str, subprocess.CompletedProcess[str]]


def ros2_environment() -> dict[str, str]:
    """This process's environment on a domain of this test's own, output as it comes."""
    return {**os.environ, "ROS_DOMAIN_ID": DOMAIN, "PYTHONUNBUFFERED": "1", "COLUMNS": "80"}


@pytest.fixture(scope="module")
def sample() -> Iterator[None]:
    """The sample node in a process of its own."""
    process = subprocess.Popen(
        [sys.executable, ROOT / "tests/fixtures/sample_node.py"],
        env=ros2_environment(),
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    yield
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=10) == 0


class Ros2:
    """A `ros2` command, the stand-in or the genuine one."""

    def __init__(self, command: str) -> None:
        self.command = command

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Start a command that goes on until it is interrupted."""
        return subprocess.Popen(
            [self.command, *arguments], env=ros2_environment(), stdout=subprocess.PIPE, text=True
        )

    def __call__(self, *arguments: str, **env: str) -> subprocess.CompletedProcess[str]:
        """Run a command to its end."""
        return subprocess.run(
            [self.command, *arguments],
            env={**ros2_environment(), **env},
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )


def commands() -> list[str]:
    """The stand-in, and the genuine command where there is one."""
    other = shutil.which("ros2")
    genuine = other is not None and not Path(other).samefile(STAND_IN)
    return [str(STAND_IN), other] if other is not None and genuine else [str(STAND_IN)]


@pytest.fixture(scope="module", params=commands())
def ros2(request: pytest.FixtureRequest) -> Ros2:
    """Every `ros2` command that there is to test."""
    return Ros2(request.param)


# Time for the graph to be seen on a busy machine; the stand-in is done earlier where it can.
PATIENT = ("--spin-time", "5", "--no-daemon")

JOINTS = """\
header:
  stamp:
    sec: 0
    nanosec: 0
  frame_id: base
name:
- knee
- hip
position:
- 0.5
- -1.0
velocity:
- 0.0
- 0.0
- 0.0
effort: []
---
"""

OUTPUTS = {
    "topic type /joints": "sensor_msgs/msg/JointState\n",
    "topic info /mixed": ("Type: std_msgs/msg/String\nPublisher count: 2\nSubscription count: 0\n"),
    "topic echo /joints --once": JOINTS,
    "topic echo /joints sensor_msgs/JointState --once": JOINTS,
    "topic echo /joints --once --csv": "0,0,base,knee,hip,0.5,-1.0,0.0,0.0,0.0,\n",
    "topic echo /joints --once --no-arr --field header": (
        "stamp:\n  sec: 0\n  nanosec: 0\nframe_id: base\n---\n"
    ),
    "topic echo /joints --once --field position": "array('d', [0.5, -1.0])\n---\n",
    "topic echo /joints --once --field header.frame_id": "base\n---\n",
    "topic echo /joints --once --filter len(m)==2 --field name": "['knee', 'hip']\n---\n",
    "topic echo /text --once --truncate-length 3": "data: xxx...\n---\n",
    "topic echo /latched --once": "data: once\n---\n",
    "topic echo /latched --timeout 0.5 --qos-durability volatile": "",
    "topic echo /mixture --once --filter m.data=='best-effort'": (
        "Some, but not all, publishers are offering QoSReliabilityPolicy.RELIABLE. Falling back to "
        "QoSReliabilityPolicy.BEST_EFFORT as it will connect to all publishers\n"
        "data: best-effort\n---\n"
    ),
    "node list": "/arm/device\n/sample\n",
    "node list -c": "2\n",
    "param get /sample gains.kp": "Double value is: 300.0\n",
    "param get sample gains.legs": "Double values are: [1.0, 2.5]\n",
    "param get /sample enabled": "Boolean value is: True\n",
    "param get /sample names --hide-type": "['a', 'b']\n",
    "param dump /arm/device": (
        "/arm/device:\n  ros__parameters:\n    start_type_description_service: true\n"
        "    use_sim_time: false\n\n"
    ),
    "param describe /sample gains.kp": (
        "Parameter name: gains.kp\n  Type: double\n  Description: position gain, N m/rad\n"
        "  Constraints:\n    Min value: 0.0\n    Max value: 500.0\n"
    ),
    "param list /sample --filter gains": "  gains.kp\n  gains.legs\n",
    "lifecycle nodes": "/arm/device\n",
    "lifecycle get": "/arm/device: unconfigured [1]\n",
    "lifecycle get /arm/device": "unconfigured [1]\n",
    "lifecycle list /arm/device": (
        "- configure [1]\n\tStart: unconfigured\n\tGoal: configuring\n"
        "- shutdown [5]\n\tStart: unconfigured\n\tGoal: shuttingdown\n"
    ),
}

ERRORS = {
    "topic info /nothing": "Unknown topic '/nothing'\n",
    "topic echo /nothing --once": "Could not determine the type for the passed topic\n",
    "topic echo /joints nope/msg/JointState": "The passed message type is invalid\n",
    "topic echo /joints --once --field nope": (
        "Invalid field 'nope': 'JointState' object has no attribute 'nope'\n"
    ),
    "node info /nope": "Unable to find node '/nope'\n",
    "param get /sample nope": "Parameter not set\n",
    "param get /nope count": "Node not found\n",
    "lifecycle get /sample": "Node not found\n",
    "lifecycle set /arm/device activate": (
        "Unknown transition requested, available ones are:\n- configure [1]\n- shutdown [5]\n"
    ),
}

LISTS = (  # what they print is looked at in parts
    "topic list -t",
    "topic list -v",
    "topic list --include-hidden-topics",
    "topic info -v /joints",
    "node info /sample",
    "service list -t",
    "service list -c",
)

CALLS = {  # command: exit code, a line of stdout, stderr
    "topic pub -1 -w 0 /nobody geometry_msgs/Vector3Stamped {nope: 1}": (
        1,
        "",
        "Failed to populate field: 'Vector3Stamped' object has no attribute 'nope'\n",
    ),
    "topic pub -1 -w 0 /nobody std_msgs/String hello": (
        1,
        "",
        "The passed value needs to be a dictionary in YAML format\n",
    ),
    "topic pub -1 -w 0 /nobody nope {}": (1, "", "The passed message type is invalid\n"),
    "topic pub -1 /nobody std_msgs/String --max-wait-time-secs 0.1": (
        1,
        "Waiting for at least 1 matching subscription(s)...\n",
        "Timed out waiting for subscribers: Expected 1 subcribers but only got 0 subscribers\n",
    ),
    "topic pub -1 -w 0 /nobody sensor_msgs/msg/JointState {position: [1, 2.5]}": (
        0,
        "publisher: beginning loop\npublishing #1: sensor_msgs.msg.JointState(header="
        "std_msgs.msg.Header(stamp=builtin_interfaces.msg.Time(sec=0, nanosec=0), frame_id=''), "
        "name=[], position=[1.0, 2.5], velocity=[], effort=[])\n\n",
        "",
    ),
    "service call /set_bool std_srvs/srv/SetBool {data: true}": (
        0,
        "requester: making request: std_srvs.srv.SetBool_Request(data=True)\n\nresponse:\n"
        "std_srvs.srv.SetBool_Response(success=True, message='was True')\n\n",
        "",
    ),
    "service call /trigger std_srvs/srv/Nope": (1, "", "The passed service type is invalid\n"),
    "service call /set_bool std_srvs/srv/SetBool {nope: 1}": (
        1,
        "",
        "Failed to populate field: 'SetBool_Request' object has no attribute 'nope'\n",
    ),
    "run nope nope": (1, "", "Package 'nope' not found\n"),
    "run husky_msgs nope": (1, "", "No executable found\n"),
}


def words(line: str) -> list[str]:
    """A command line's words; braces hold one word together."""
    return re.findall(r"\{.*\}|\S+", line)


@pytest.fixture(scope="module")
def results(ros2: Ros2, sample: None) -> Results:
    """What comes of all commands that do not change anything, several at a time."""
    lines = {line: [*words(line), *PATIENT] for line in (*OUTPUTS, *ERRORS, *LISTS)}
    lines |= {line: words(line) for line in CALLS}
    with ThreadPoolExecutor(8) as pool:
        done = pool.map(lambda arguments: ros2(*arguments), lines.values())
        return dict(zip(lines, done, strict=True))


@pytest.mark.parametrize("line", OUTPUTS)
def test_output(results: Results, line: str) -> None:
    result = results[line]
    assert (result.stdout, result.stderr, result.returncode) == (OUTPUTS[line], "", 0)


@pytest.mark.parametrize("line", ERRORS)
def test_error(results: Results, line: str) -> None:
    result = results[line]
    assert (result.stderr, result.returncode) == (ERRORS[line], 1)


@pytest.mark.parametrize("line", CALLS)
def test_call(results: Results, line: str) -> None:
    code, stdout, stderr = CALLS[line]
    result = results[line]
    said = result.stdout.replace("waiting for service to become available...\n", "")
    assert (result.returncode, said, result.stderr) == (code, stdout, stderr)


def test_topic_list_shows_types_and_counts(results: Results) -> None:
    with_types = results["topic list -t"].stdout.splitlines()
    assert "/joints [sensor_msgs/msg/JointState]" in with_types
    assert not [line for line in with_types if "_hidden" in line]
    published, subscribed = results["topic list -v"].stdout.split("Subscribed topics:\n")
    assert published.startswith("Published topics:\n")
    assert " * /mixed [std_msgs/msg/String] 2 publishers\n" in published
    assert " * /command [geometry_msgs/msg/TwistStamped] 1 subscriber\n" in subscribed
    assert "/_hidden\n" in results["topic list --include-hidden-topics"].stdout


def test_topic_info_shows_the_quality_of_service(results: Results) -> None:
    said = results["topic info -v /joints"].stdout
    assert "Node name: sample\nNode namespace: /\nTopic type: sensor_msgs/msg/JointState\n" in said
    assert "  Reliability: BEST_EFFORT\n" in said
    assert "\n\nSubscription count: " in said


def test_node_info_shows_what_a_node_offers(results: Results) -> None:
    said = results["node info /sample"].stdout
    assert said.startswith(
        "/sample\n  Subscribers:\n    /command: geometry_msgs/msg/TwistStamped\n  Publishers:\n"
    )
    assert "    /set_bool: std_srvs/srv/SetBool\n" in said.split("  Service Servers:\n")[1]
    assert said.endswith("  Service Clients:\n\n  Action Servers:\n\n  Action Clients:\n\n")


def test_services_are_listed_with_their_types(results: Results) -> None:
    listed = results["service list -t"].stdout.splitlines()
    assert "/trigger [std_srvs/srv/Trigger]" in listed
    assert int(results["service list -c"].stdout) == len(listed)


def test_parameters_are_set_and_refused(ros2: Ros2, sample: None) -> None:
    assert ros2("param", "set", "/sample", "count", "5").stdout == "Set parameter successful\n"
    assert ros2("param", "get", "/sample", "count").stdout == "Integer value is: 5\n"
    refused = ros2("param", "set", "/sample", "count", "13")
    assert refused.stderr == "Setting parameter failed: 13 is refused\n"
    beyond = ros2("param", "set", "/sample", "gains.kp", "900.0")
    assert beyond.stderr.startswith("Setting parameter failed: ")
    assert ros2("param", "get", "/sample", "count").stdout == "Integer value is: 5\n"


def test_lifecycle_nodes_are_taken_through_their_states(ros2: Ros2, sample: None) -> None:
    def change(transition: str) -> str:
        result = ros2("lifecycle", "set", "/arm/device", transition, *PATIENT)
        return result.stdout + result.stderr

    assert change("configure") == "Transitioning successful\n"
    assert change("activate") == "Transitioning failed\n"
    assert ros2("lifecycle", "get", "/arm/device", *PATIENT).stdout == "inactive [2]\n"
    assert change("cleanup") == "Transitioning successful\n"


def test_published_messages_arrive(ros2: Ros2, sample: None) -> None:
    said = ros2(
        "topic", "pub", "-t", "2", "-r", "20", "/command", "geometry_msgs/TwistStamped",
        "{twist: {linear: {x: 1}}}",
    ).stdout  # fmt: skip
    assert "publisher: beginning loop\npublishing #1: geometry_msgs.msg.TwistStamped(" in said
    assert "publishing #2: " in said
    received = ros2("topic", "echo", "/received", "--once", "--field", "twist.linear.x", *PATIENT)
    assert received.stdout == "1.0\n---\n"


def test_echo_waits_for_a_publisher_where_it_sees_only_another_subscriber(ros2: Ros2) -> None:
    """What is latched reaches only a subscriber that asks for it, as the publisher offers it."""
    message = ("-1", "-w", "0", "/late", "std_msgs/String", "{data: once}")
    latched = ("--qos-durability", "transient_local", "--spin-time", "0", "--keep-alive", "60")
    briefly = ("--spin-time", "1", "--no-daemon")
    looking = ("--spin-time", "10", "--no-daemon")
    other = ros2.start("topic", "echo", "/late", "std_msgs/String")
    started = [other]
    try:
        while ros2("topic", "type", "/late", *PATIENT).returncode != 0:
            assert other.poll() is None
        started.append(ros2.start("topic", "echo", "/late", "--once", *looking))
        # The two echoes and this listing itself: both look, and nobody has published yet.
        while ros2("node", "list", "-a", *briefly).stdout.count("/_ros2cli_") < 3:
            assert started[1].poll() is None
        started.append(ros2.start("topic", "pub", *message, *latched))
        assert started[1].communicate(timeout=60)[0] == "data: once\n---\n"
    finally:
        for process in started:
            process.kill()
            process.communicate()


def test_rate_is_reported_every_second_until_interrupted(ros2: Ros2, sample: None) -> None:
    process = ros2.start("topic", "hz", "/joints", "-w", "10")
    assert process.stdout is not None
    lines = [process.stdout.readline() for _ in range(2)]
    process.send_signal(signal.SIGINT)
    process.wait(timeout=10)
    assert re.fullmatch(r"average rate: [0-9]+\.[0-9]{3}\n", lines[0])
    assert re.fullmatch(
        r"\tmin: \d\.\d{3}s max: \d\.\d{3}s std dev: \d\.\d{5}s window: 10\n", lines[1]
    )


# ------------------------------------------------------------------ of the stand-in alone
stand_in = Ros2(str(STAND_IN))


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """An install prefix with the package `demo` and its executable `say`."""
    marker = tmp_path / "share/ament_index/resource_index/packages/demo"
    marker.parent.mkdir(parents=True)
    marker.touch()
    say = tmp_path / "lib/demo/say"
    say.parent.mkdir(parents=True)
    say.write_text('#!/bin/sh\necho "$$" "$@"\n[ "$1" != wait ] || exec sleep 60\nexit 7\n')
    say.chmod(0o755)
    return tmp_path


def test_run_passes_arguments_and_exit_code(prefix: Path) -> None:
    arguments = ("--ros-args", "-p", "name:=a b", "-h")
    result = stand_in("run", "demo", "say", *arguments, AMENT_PREFIX_PATH=f"/none:{prefix}")
    assert result.stdout.split(" ", 1)[1] == " ".join(arguments) + "\n"
    assert result.returncode == 7


def test_run_puts_a_prefix_before_the_executable(prefix: Path) -> None:
    result = stand_in("run", "--prefix", "echo -n", "demo", "say", AMENT_PREFIX_PATH=str(prefix))
    assert result.stdout == str(prefix / "lib/demo/say")


def test_run_becomes_the_node_so_that_signals_reach_it(prefix: Path) -> None:
    process = subprocess.Popen(
        [STAND_IN, "run", "demo", "say", "wait"],
        env={**ros2_environment(), "AMENT_PREFIX_PATH": str(prefix)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == f"{process.pid} wait\n"
    process.terminate()
    assert process.wait(timeout=10) == -signal.SIGTERM


def test_run_refuses_to_choose_between_two(prefix: Path) -> None:
    other = prefix / "lib/demo/more/say"
    other.parent.mkdir()
    shutil.copy(prefix / "lib/demo/say", other)
    result = stand_in("run", "demo", "say", AMENT_PREFIX_PATH=str(prefix))
    assert result.returncode == 1
    assert result.stderr.startswith("Multiple executables found:\n- ")


def test_what_the_stand_in_lacks_is_said() -> None:
    result = stand_in("bag", "record")
    assert result.returncode == 2
    assert "'bag' is not in this stand-in" in result.stderr
    assert "invalid choice: 'nonsense'" in stand_in("topic", "nonsense").stderr
    assert stand_in("topic").stdout.startswith("usage: ros2 topic [-h]")


def test_bad_yaml_is_refused_in_a_sentence() -> None:
    result = stand_in("topic", "pub", "-1", "-w", "0", "/nobody", "std_msgs/String", "{data: [")
    assert result.returncode == 1
    assert result.stderr.startswith("The passed values are not valid YAML: ")
    assert "Traceback" not in result.stderr


def test_now_and_auto_become_the_time_of_sending() -> None:
    before = time.time()
    result = stand_in(
        "topic", "pub", "-1", "-w", "0", "/nobody", "geometry_msgs/PointStamped", "{header: auto}"
    )
    stamp = re.search(r"Time\(sec=(\d+), nanosec=(\d+)\)", result.stdout)
    assert stamp is not None
    assert before - 1 <= int(stamp[1]) + int(stamp[2]) * 1e-9 <= time.time()

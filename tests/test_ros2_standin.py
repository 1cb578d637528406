"""The stand-in `ros2` command prints what Jazzy's ros2cli prints.

The expected texts were compared with ros2cli 0.32; where a genuine `ros2` is on PATH, it has to
pass the same tests, except where a test says that the original fails.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from ros2_command import ROOT, STAND_IN, Ros2, commands, ros2_environment, words
from ros2_said import CALLS, ERRORS, GOALS, LISTS, OUTPUTS

pytest.importorskip("rclpy")
pytestmark = pytest.mark.graph

Results = dict[str, subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def sample(domain: int) -> Iterator[None]:
    """The sample node in a process of its own."""
    process = subprocess.Popen(
        [sys.executable, ROOT / "tests/fixtures/sample_node.py"],
        env=ros2_environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,  # it says itself that one of its topics does not match
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    yield
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=10) == 0


@pytest.fixture(scope="module", params=commands())
def ros2(request: pytest.FixtureRequest, domain: int) -> Iterator[Ros2]:
    """Every `ros2` command that there is to test."""
    command = Ros2(request.param)
    if command.is_genuine:
        command("daemon", "start")
    yield command
    if command.is_genuine:
        command("daemon", "stop")


# Time for the graph to be seen on a busy machine; the stand-in is done earlier where it can.
PATIENT = ("--spin-time", "5", "--no-daemon")
BRIEF = ("--spin-time", "1", "--no-daemon")


def patience(ros2: Ros2, line: str) -> tuple[str, ...]:
    """PATIENT where a command looks at the graph; the genuine one asks its daemon for some."""
    if line.startswith(("interface ", "pkg ")):
        return ()
    if line.startswith("topic echo /nothing"):
        return BRIEF  # of it, `echo` waits for five times as long
    by_daemon = ros2.is_genuine and line.startswith(("action ", "doctor ", "service find "))
    return () if by_daemon else PATIENT


def once_a_verb(lines: Iterable[str]) -> list[Any]:
    """Command lines as pytest's parameters: all but the first of each verb are slow."""
    verbs: set[tuple[str, ...]] = set()
    parameters = []
    for line in lines:
        verb = tuple(line.split()[:2])
        parameters.append(pytest.param(line, marks=[pytest.mark.slow] * (verb in verbs)))
        verbs.add(verb)
    return parameters


@pytest.fixture(scope="module")
def results(request: pytest.FixtureRequest, ros2: Ros2, sample: None) -> Results:
    """What comes of all commands that do not change anything, several at a time."""
    here = [item for item in request.session.items if item.path == request.path]
    wanted = {item.callspec.params.get("line") for item in here if hasattr(item, "callspec")}
    lines = {line: [*words(line), *patience(ros2, line)] for line in (*OUTPUTS, *ERRORS)}
    lines |= {line: words(line) for line in CALLS}
    lines = {line: lines[line] for line in lines if line in wanted}
    lines |= {line: [*words(line), *patience(ros2, line)] for line in LISTS}
    with ThreadPoolExecutor(16) as pool:  # most of them wait
        done = pool.map(lambda arguments: ros2(*arguments), lines.values())
        return dict(zip(lines, done, strict=True))


@pytest.mark.parametrize("line", once_a_verb(OUTPUTS))
def test_output(results: Results, line: str) -> None:
    result = results[line]
    assert (result.stdout, result.stderr, result.returncode) == (OUTPUTS[line], "", 0)


@pytest.mark.parametrize("line", once_a_verb(ERRORS))
def test_error(results: Results, line: str) -> None:
    result = results[line]
    assert (result.stderr, result.returncode) == (ERRORS[line], 1)


@pytest.mark.parametrize("line", once_a_verb(CALLS))
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


def test_packages_with_actions_are_listed(results: Results) -> None:
    """Which others there are is for the ROS in use to say."""
    packages = results["interface packages -a"].stdout.splitlines()
    assert "husky_msgs" in packages and "std_srvs" not in packages


def test_node_info_shows_what_a_node_offers(results: Results) -> None:
    said = results["node info /sample"].stdout
    assert said.startswith(
        "/sample\n  Subscribers:\n    /command: geometry_msgs/msg/TwistStamped\n"
        "    /mismatched: std_msgs/msg/String\n  Publishers:\n"
    )
    assert "    /set_bool: std_srvs/srv/SetBool\n" in said.split("  Service Servers:\n")[1]
    plan = "    /plan: husky_msgs/action/PlanIncline\n"
    assert said.endswith(
        f"  Service Clients:\n\n  Action Servers:\n{plan}  Action Clients:\n{plan}"
    )


def test_services_are_listed_with_their_types(results: Results) -> None:
    listed = results["service list -t"].stdout.splitlines()
    assert "/trigger [std_srvs/srv/Trigger]" in listed
    assert int(results["service list -c"].stdout) == len(listed)


def test_parameters_are_set_and_refused(ros2: Ros2, sample: None) -> None:
    set_it, get_it = ("param", "set", "/sample", *PATIENT), ("param", "get", "/sample", *PATIENT)
    assert ros2(*set_it, "count", "5").stdout == "Set parameter successful\n"
    assert ros2(*get_it, "count").stdout == "Integer value is: 5\n"
    refused = ros2(*set_it, "count", "13")
    assert refused.stderr == "Setting parameter failed: 13 is refused\n"
    beyond = ros2(*set_it, "gains.kp", "900.0")
    assert beyond.stderr.startswith("Setting parameter failed: ")
    assert ros2(*get_it, "count").stdout == "Integer value is: 5\n"


def test_parameters_are_loaded_from_a_file(ros2: Ros2, sample: None, tmp_path: Path) -> None:
    file = tmp_path / "sample.yaml"
    own = "/sample: {ros__parameters: {count: 13}}"
    file.write_text(f"{own}\n/**: {{ros__parameters: {{numbers: [3, 4]}}}}\n")
    loaded = ros2("param", "load", "/sample", str(file), *PATIENT)
    assert loaded.stdout == "Set parameter numbers successful\n"
    assert loaded.stderr == "Set parameter count failed: 13 is refused\n"
    alone = ros2("param", "load", "--no-use-wildcard", "/sample", str(file), *PATIENT)
    assert (alone.stdout, alone.stderr) == ("", loaded.stderr)


def test_parameters_are_deleted_where_their_type_may_change(ros2: Ros2, sample: None) -> None:
    name = "loose.genuine" if ros2.is_genuine else "loose.stand_in"
    delete = ("param", "delete", "/sample", *PATIENT)
    assert ros2(*delete, name).stdout == "Deleted parameter successfully\n"
    assert ros2("param", "get", "/sample", name, *PATIENT).stderr == "Parameter not set\n"
    refused = ros2(*delete, "count").stderr
    assert refused.startswith("Deleting parameter failed: ")


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
    looking = ("--spin-time", "10", "--no-daemon")
    other = ros2.start("topic", "echo", "/late", "std_msgs/String")
    started = [other]
    try:
        while ros2("topic", "type", "/late", *PATIENT).returncode != 0:
            assert other.poll() is None
        started.append(ros2.start("topic", "echo", "/late", "--once", *looking))
        # The two echoes and this listing itself: both look, and nobody has published yet.
        while ros2("node", "list", "-a", *BRIEF).stdout.count("/_ros2cli_") < 3:
            assert started[1].poll() is None
        started.append(ros2.start("topic", "pub", *message, *latched))
        assert started[1].communicate(timeout=60)[0] == "data: once\n---\n"
    finally:
        for process in started:
            process.kill()
            process.communicate()


RUNNING = {  # command: what it says again and again
    "topic hz /joints -w 10": (
        r"average rate: [0-9]+\.[0-9]{3}\n"
        r"\tmin: \d\.\d{3}s max: \d\.\d{3}s std dev: \d\.\d{5}s window: 10\n"
    ),
    "topic bw /cloud -w 5": (
        r"Subscribed to \[/cloud\]\n\d+\.\d\d KB/s from 5 messages\n"
        r"\tMessage size mean: 0\.\d\d KB min: 0\.\d\d KB max: 0\.\d\d KB\n"
    ),
    "topic delay /joints -w 5": (  # stamped with 0
        r"average delay: \d{10}\.\d{3}\n"
        r"\tmin: \d{10}\.\d{3}s max: \d{10}\.\d{3}s std dev: \d\.\d{5}s window: 5\n"
    ),
    "service echo /set_bool std_srvs/srv/SetBool": (
        r"info:\n  event_type: REQUEST_RECEIVED\n  stamp:\n    sec: \d+\n    nanosec: \d+\n"
        r"  client_gid:\n(  - \d+\n){16}  sequence_number: \d+\n"
        r"request:\n- data: true\nresponse: \[\]\n---\n"
    ),
    "service call -r 2 /set_bool std_srvs/srv/SetBool {data: true}": (
        r"requester: making request: .*\n\nresponse:\nstd_srvs\.srv\.SetBool_Response\(.*\)\n"
    ),
}


def test_what_goes_on_and_on_is_said_until_interrupted(ros2: Ros2, sample: None) -> None:
    processes = {line: ros2.start(*words(line)) for line in RUNNING}
    try:
        for line, expected in RUNNING.items():
            stdout = processes[line].stdout
            assert stdout is not None
            said = ""
            while not re.search(expected, said):
                more = stdout.readline()
                assert more and len(said) < 10_000, f"{line} said {said}"
                said += more
        for process in processes.values():
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=10)
    finally:
        for process in processes.values():
            process.kill()
            process.communicate()


@pytest.mark.parametrize("goal", GOALS)
def test_a_goal_is_refused(ros2: Ros2, sample: None, goal: str) -> None:
    result = ros2("action", "send_goal", "/plan", "husky_msgs/action/PlanIncline", goal)
    assert (result.returncode, result.stdout, result.stderr) == GOALS[goal]


def test_a_goal_is_followed_to_its_end(ros2: Ros2, sample: None) -> None:
    goal = ("/plan", "husky_msgs/action/PlanIncline", "{gait: none}")
    result = ros2("action", "send_goal", "--feedback", *goal)
    assert re.search(
        r"\nGoal accepted with ID: [0-9a-f]{32}\n\n"
        r"Feedback:\n    stage: solving\nelapsed: 0\.5\n\n"
        r"Result:\n    success: true\nreason: ''\nconstraint: ''\nmessage: planned\nplan:\n",
        result.stdout,
    )
    assert result.stdout.endswith("\n\nGoal finished with status: ABORTED\n")
    assert (result.returncode, result.stderr) == (0, "")


def test_doctor_finds_what_does_not_match(results: Results) -> None:
    """A reliable subscriber hears nothing of a best-effort publisher, and neither says so."""
    checked = results["doctor -ep -iw"]
    fault = "Best effort publisher and reliable subscription;"
    assert f"QoS compatibility error found on topic '/mismatched': {fault}\n" in checked.stderr
    assert "Publisher without subscriber detected on /joints.\n" in checked.stderr
    assert re.search(r"\n\d/\d check\(s\) failed\n\nFailed modules: .*middleware", checked.stdout)
    said = results["doctor -r -ep"].stdout
    assert "\n   PLATFORM INFORMATION\nsystem           : Linux\n" in said
    assert "\n   RMW MIDDLEWARE\nmiddleware name    : rmw_" in said
    assert (
        "topic [type]            : /mismatched [std_msgs/msg/String]\n"
        "publisher node          : sample\nsubscriber node         : sample\n"
        f"compatibility status    : ERROR: {fault}\n"
    ) in said
    assert (
        "topic               : /joints\npublisher count     : 1\nsubscriber count    : 0\n" in said
    )


# ------------------------------------------------------------------ better than the original
def test_an_interrupt_takes_the_goal_back(sample: None) -> None:
    """The original ends its context before it cancels, and fails."""
    goal = ("/plan", "husky_msgs/action/PlanIncline", "{gait: patience}")
    process = Ros2(str(STAND_IN)).start("action", "send_goal", *goal)
    assert process.stdout is not None
    try:
        while "Goal accepted" not in (line := process.stdout.readline()):
            assert line
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=60)
    finally:
        process.kill()
    assert said.lstrip("\n") == "Canceling goal...\nGoal canceled.\n"
    assert process.returncode == 2

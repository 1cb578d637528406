"""The graph across containers: it walks, tools see it, it bears what may happen to containers."""

import itertools
import re

import pytest
from containers import END_PERIOD
from node_faults import *  # noqa: F403

from husky_bringup.processes import Strangers
from husky_experiments.scenario import trot
from husky_experiments.session import SessionError
from husky_runtime import graph

pytestmark = [pytest.mark.graph, pytest.mark.docker]

LOOK = """
look() { # topic: what echo and hz say
    echo "echo $1: $(timeout 60 ros2 topic echo --once "$1" 2>&1 | wc -l)"
    [ "$2" = once ] || echo "hz $1: $(timeout 60 ros2 topic hz "$1" 2>&1 | grep -m 1 average)"
}
"""


def test_stands_up_and_trots_for_5_s_in_lockstep(robot, record_property):
    trot(robot.session)
    assert robot.stands, robot.seen
    record_property("simulated_s", robot.session.time)


def test_image_is_small_and_without_root(engine, image):
    told = engine.run("image", "inspect", "--format", "{{.Size}} {{.Config.User}}", image)
    size, user = told.split()
    assert int(size) < 1.0e9, f"{int(size) / 1e6:.0f} MB"
    assert user == "8000:8000"


def test_tools_see_every_topic_of_the_table(robot, containers):
    """`ros2 topic list`, `echo` and `hz` in a container of their own, while the world goes on."""
    absent = {graph.TELEOP, graph.CONSOLE, graph.PLANNER}  # started by who wants them
    eyes = {graph.D435_DRIVER, graph.ELEVATION_MAPPER, graph.LOCALIZER}  # of another profile
    topics = [topic for topic in graph.TOPICS if not topic.publishers or {*topic.publishers} - eyes]
    published = [topic for topic in topics if set(topic.publishers) - absent]
    often = {}  # of each node one topic: what is heard once of the others comes the same way
    for topic in published:
        if topic.rate > 0.0:
            often.setdefault(topic.publishers, topic.name)
    calls = [
        f"look {topic.name} {'often' if topic.name in often.values() else 'once'}"
        for topic in published
    ]
    pairs = itertools.zip_longest(calls[::2], calls[1::2], fillvalue=":")
    both = "\n".join(f"{first} & {second}; wait" for first, second in pairs)
    lists = "ros2 topic list -t\n" * 3  # discovery between containers takes its time
    script = f"{LOOK}\n{lists}{both}\n"
    robot.session.pause(False)
    try:
        seen = containers.compose(
            "--profile", "tools", "run", "--rm", "-T", "tools", "bash", "-c", script, timeout=600.0
        )
    finally:
        robot.session.pause()
    for topic in topics:
        kinds = re.search(rf"^{topic.name} \[(.*)\]$", seen, re.MULTILINE)
        assert kinds and topic.type in kinds[1].split(", "), seen
    for topic in published:
        lines = re.search(rf"^echo {topic.name}: (\d+)$", seen, re.MULTILINE)
        assert lines and int(lines[1]) > 1, f"{topic.name}\n{seen}"
        rate = re.search(rf"^hz {topic.name}: average rate: ([\d.]+)", seen, re.MULTILINE)
        if topic.name in often.values():
            assert rate and float(rate[1]) > 0.0, f"{topic.name}\n{seen}"


# What may happen to a container besides what happens to its node (node_faults) --------------------
def test_controller_container_unplugged(trotting, containers, record_property):
    """Its cable pulled and plugged in again: as standing still, and it finds its way back."""
    s = trotting.session
    cut = trotting.watch()
    containers.plug(graph.LOW_LEVEL_CONTROLLER, False)
    s.advance(0.9)
    record_property("reaction_s", trotting.put_down(cut))
    assert s.drives.reason == "no joint command", trotting.seen
    containers.plug(graph.LOW_LEVEL_CONTROLLER, True)
    trotting.until_damped()
    trotting.recover()


def test_controller_container_cut_off(trotting, containers, record_property):
    """Its interface taken away: a new one needs a new start, as Fast DDS looks for them once."""
    s = trotting.session
    cut = trotting.watch()
    containers.cut_off(graph.LOW_LEVEL_CONTROLLER)
    s.advance(0.9)
    record_property("reaction_s", trotting.put_down(cut))
    assert s.drives.reason == "no joint command", trotting.seen
    containers.connect(graph.LOW_LEVEL_CONTROLLER)
    code, _ = containers.stop(graph.LOW_LEVEL_CONTROLLER)
    assert code == 0, containers.log(graph.LOW_LEVEL_CONTROLLER)
    s.start(graph.LOW_LEVEL_CONTROLLER)
    trotting.recover()


def test_a_node_that_dies_is_started_again(robot, containers):
    """By the restart policy: nobody has told the container to stop."""
    name = graph.T265_DRIVER
    before = containers.state(name)["Pid"]
    containers.signal_node(name, f"husky_drivers/{name}", "KILL")

    def is_back() -> bool:
        state = containers.state(name)
        return state["Running"] is True and state["Pid"] not in (0, before)

    try:
        robot.session.wait_for(is_back, f"a new process of {name}")
    except SessionError as error:
        pytest.fail(f"{error}; {containers.state(name)}; it has said:\n{containers.log(name)}")
    robot.reported(name, "tracking", "frozen", "waiting")


def test_health_is_of_the_node_and_not_of_its_container(robot, containers):
    """A process that stands still is running, and not healthy."""
    name = graph.T265_DRIVER
    s = robot.session
    s.wait_for(lambda: containers.health(name) == "healthy", f"{name} healthy")
    containers.signal_node(name, f"husky_drivers/{name}", "STOP")
    s.wait_for(lambda: containers.health(name) == "unhealthy", f"{name} unhealthy")
    containers.signal_node(name, f"husky_drivers/{name}", "CONT")
    s.wait_for(lambda: containers.health(name) == "healthy", f"{name} healthy")


def test_docker_stop_ends_every_node_within_3_s(robot, containers):
    """The last test of the graph: exit code 0, and no traceback in a log of any test before."""
    session = robot.session
    names = [spec.name for spec in session.specs]
    ends = {name: containers.stop(name) for name in names}
    logs = {name: containers.log(name) for name in names}
    session.processes = Strangers()
    for name, (code, duration) in ends.items():
        assert code == 0, f"{name}: {code}\n{logs[name][-3000:]}"
        assert duration <= END_PERIOD, f"{name} took {duration:.1f} s"
        assert "Traceback" not in logs[name], logs[name][-3000:]

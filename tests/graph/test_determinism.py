"""The same seed gives the same trajectory over the processes, whatever the wall clock does."""

import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from grid_map_msgs.msg import GridMap
from seen_robot import SETTINGS
from sensor_msgs.msg import Image

from husky_description.robot import load_robot
from husky_experiments.scripts import push, walk
from husky_runtime import graph
from husky_runtime.nodes import stamps
from husky_sim.devices.d435.optics import D435Optics
from husky_sim.scene import WorldOptions
from husky_sim.world import World

pytestmark = pytest.mark.graph

ROOT = Path(__file__).resolve().parents[2]


STEPS = 20
TICKS = 10
"""Of each step."""
IMAGE_PERIOD = 100_000_000
"""Of the depth camera [ns]."""
PATIENCE = 120.0
"""Wall time after which nobody refuses any more [s]."""


def script(robot, meanwhile=lambda step: None) -> str:
    """Stand up, trot, be pushed, each at its tick; return the digest of the trajectory.

    While it trots on, to the left and to the right by turns, `meanwhile` is called before the last
    tick of each of `STEPS` steps.
    """
    s = robot.session
    s.advance(0.2)
    assert robot.trigger(graph.DRIVES_ENABLE) == "", robot.seen
    s.advance(0.3)
    s.set_mode("stand_up")
    s.advance(1.5)
    assert robot.mode == "stand", robot.seen
    s.set_gait("trot")
    walk(s, 0.4, (0.3, 0.0, 0.0))
    assert robot.mode == "walk", robot.seen
    push(s, (0.0, 2.0))
    for step in range(STEPS):
        walk(s, graph.TICK_PERIOD * (TICKS - 1), (0.3, 0.1 * (-1) ** step, 0.0))
        meanwhile(step)
        s.advance(graph.TICK_PERIOD)
    assert robot.mode == "walk" and s.truth.pose.pose.position.x > 0.05, robot.seen
    return s.trajectory_sha256


def first_script(robot, meanwhile=lambda step: None) -> str:
    """The script with nodes that may have just started: the IMU must have been found before."""
    robot.until(
        lambda: "streaming" in robot.reported(graph.VN200_DRIVER, "").message,
        "the IMU's samples",
        within=5.0,
        step=0.2,
    )
    robot.start_again()
    return script(robot, meanwhile)


@pytest.fixture(scope="module")
def digest(graph_of_module):
    """Of the first run."""
    return first_script(graph_of_module)


def beside(line: str) -> subprocess.Popen[bytes]:
    """Run a line of a shell that stops or wakes nodes, in a process of its own.

    Who is stopped may hold a lock of the shared memory. Where this process waits for that, as it
    publishes something, none of its own threads runs to wake him.
    """
    return subprocess.Popen(("sh", "-c", line))


def test_after_a_reset_with_stalls(digest, robot):
    """Nodes that stand still for less than the grace period are waited for."""
    nodes = (graph.LOW_LEVEL_CONTROLLER, graph.DRIVE_BRIDGE, graph.VN200_DRIVER) * 3
    groups = [-robot.session.processes.process_group(node) for node in nodes]
    stall = "sleep 0.1; kill -s STOP -- {0}; sleep 0.05; kill -s CONT -- {0}"
    stalls = beside("; ".join(stall.format(group) for group in groups))
    try:
        assert script(robot) == digest
    finally:
        assert stalls.wait(PATIENCE) == 0


def test_with_a_controller_that_wakes_up_late(digest, robot):
    """A command that is sent after a tick is not of that tick, though both wait for it."""
    controller = -robot.session.processes.process_group(graph.LOW_LEVEL_CONTROLLER)
    wakes: list[subprocess.Popen[bytes]] = []

    def stop(step: int) -> None:
        time.sleep(0.01)  # Most likely it has answered the tick before; the digest is one anyhow.
        robot.session.processes.kill(graph.LOW_LEVEL_CONTROLLER, signal.SIGSTOP)
        # Until the tick has gone by and the next command is there.
        wakes.append(beside(f"sleep 0.05; kill -s CONT -- {controller}"))

    try:
        assert script(robot, stop) == digest
    finally:
        assert [wake.wait(PATIENCE) for wake in wakes] == [0] * len(wakes)


STARTS = {
    "bringup": ("scripts/bringup.sh", "--time", "lockstep"),
    "experiment": ("scripts/experiment.sh", "stand", "--output", "{}/out"),
    "controller": ("ros2", "run", "husky_control", graph.LOW_LEVEL_CONTROLLER),
}
"""What somebody may start a second time."""


def test_second_start_in_the_domain(domain, digest, robot, tmp_path):
    """It is refused with one line; the robot trots on, to the same trajectory as without."""
    attempts: dict[str, subprocess.Popen[str]] = {}
    give_up = time.monotonic() + PATIENCE

    def running() -> bool:
        return any(each.poll() is None for each in attempts.values())

    def attempt(step: int) -> None:
        for name, command in STARTS.items() if step == 0 else ():
            attempts[name] = subprocess.Popen(
                [word.format(tmp_path) for word in command],
                cwd=ROOT,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
        while step == STEPS - 1 and running() and time.monotonic() < give_up:
            time.sleep(0.05)
        time.sleep(0.1)  # theirs is the processor

    try:
        assert script(robot, attempt) == digest
        assert not running(), [name for name, each in attempts.items() if each.poll() is None]
    finally:
        for each in attempts.values():
            each.kill()
    for name, attempted in attempts.items():
        (line,) = attempted.communicate()[1].splitlines()
        assert attempted.returncode == 1, f"{name}: {line}"
        assert f"this robot runs already in ROS domain {domain}: " in line, name
        assert f"{graph.LOW_LEVEL_CONTROLLER} (process" in line, f"{name}: {line}"
        assert "choose another domain with ROS_DOMAIN_ID" in line, name
    assert not (tmp_path / "out").exists()  # where results of the run that goes on may be


@pytest.mark.slow  # in one process: `test_one_seed_gives_one_trajectory_to_the_bit`
def test_another_seed(digest, robot):
    robot.session.reset(seed=2)
    assert script(robot) != digest


@pytest.mark.slow
def test_in_new_processes(digest, new_graph):
    """The plant's memory of the first run is not what makes runs alike."""
    with new_graph() as another:
        assert first_script(another) == digest


# The last one here: its graph takes the place of the others'.
def test_over_ethercat_frames_and_with_the_depth_camera(digest, seeing_of_module):
    """Frames on a wire change nothing, nor do drives that answer late, nor does a camera.

    The camera's images are of their ticks: none is missing, and the first is that of the sitting
    robot in a world of this process. The ground that is mapped is level.
    """
    another = seeing_of_module
    drives = -another.session.processes.process_group(graph.DRIVE_SEGMENT)
    camera = -another.session.processes.process_group(graph.D435_DRIVER)
    images = another.tap(Image, graph.DEPTH_IMAGE, reliable=True)
    maps = another.tap(GridMap, graph.ELEVATION_MAP, reliable=True)
    stalls: list[subprocess.Popen[bytes]] = []

    def stall(step: int) -> None:
        line = "kill -s STOP -- {0}; sleep 0.3; kill -s CONT -- {0}"
        late = (drives, camera)[step // 4 % 2]
        stalls.extend([beside(line.format(late))] if step % 4 == 0 else [])

    try:
        assert first_script(another, stall) == digest
    finally:
        assert [each.wait(PATIENCE) for each in stalls] == [0] * len(stalls)
    report = another.reported(graph.DRIVE_SEGMENT, "answering")
    frames = int(next(v.value for v in report.values if v.key == "frames"))
    end = stamps.to_ns(another.session.truth.header.stamp)
    assert frames > 5e-7 * end, "not over the wire"
    taken = images.drain()
    first = max(i for i, m in enumerate(taken) if stamps.to_ns(m.header.stamp) == IMAGE_PERIOD)
    seen = {stamps.to_ns(message.header.stamp): message.data for message in taken[first:]}
    latency = round(1e9 * load_robot().d435.latency)
    due = range(IMAGE_PERIOD, end - latency, IMAGE_PERIOD)
    assert set(due) <= seen.keys() and all(stamp % IMAGE_PERIOD == 0 for stamp in seen)
    assert seen[IMAGE_PERIOD].tobytes() == image_of_the_sitting_robot().tobytes()
    another.reported(graph.ELEVATION_MAPPER, "mapping")
    layers = dict(zip((last := maps.drain()[-1]).layers, last.data, strict=True))
    ground = np.array(layers["elevation"].data)
    ground = ground[np.isfinite(ground)]
    assert len(ground) > 1000 and np.sqrt(np.mean(ground**2)) < 0.02


def image_of_the_sitting_robot():
    """Return the first image of a world whose drives are off, in millimetres."""
    robot, seed = load_robot(), SETTINGS[graph.PLANT]["seed"]
    world = World(robot, WorldOptions(seed=seed))
    while world.time_ns < IMAGE_PERIOD:
        world.step_tick()
    optics = D435Optics(world.model, robot.d435, seed)
    image = optics.image(0, optics.snapshot(world.data))
    assert np.count_nonzero(image) > 0.5 * image.size
    return image

"""The launch file and `scripts/bringup.sh` start the same nodes with the same parameters."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys

import pytest

from husky_bringup.interfaces import Reader
from husky_bringup.system import simulated_robot
from husky_runtime import graph

pytestmark = pytest.mark.graph

PARAMETERS = """
/**:
  ros__parameters:
    grace: 2.5
plant:
  ros__parameters:
    terrain: tiles
    seed: 7
    friction: 0.5
low_level_controller:
  ros__parameters:
    gait.trot.swing_height: 0.07
"""


@pytest.fixture(scope="module")
def ros2_launch():
    """The genuine `ros2 launch`; a ROS of Python wheels has none."""
    for package in ("launch", "launch_ros", "ros2launch"):
        pytest.importorskip(package, reason=f"the Python package {package} is not installed")
    command = [shutil.which("ros2") or "ros2", "launch"]
    found = subprocess.run([*command, "--help"], capture_output=True, check=False)
    if found.returncode != 0:
        pytest.skip(f"{command[0]} has no launch command")
    return command


@contextlib.contextmanager
def started(command, number, code, log):
    """Run a command, end it by a signal; it has to end with this code, and no traceback."""
    with log.open("wb") as output:
        process = subprocess.Popen(
            command, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
    try:
        yield
        process.send_signal(number)
        assert process.wait(timeout=20.0) == code, log.read_text()
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert "Traceback" not in log.read_text(), log.read_text()


def test_names_that_nobody_has(domain, ros2_launch):
    """Arguments of the launch file and parameters of nodes."""
    for argument, words in (
        ("terrain:=tiles", "there is no argument terrain; there are time"),
        ("plant.terain:=tiles", "there is no parameter terain; there is terrain"),
        ("wheels.radius:=1", "there is no node 'wheels'"),
    ):
        command = [*ros2_launch, "husky_bringup", "husky.launch.py", argument]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
        assert words in done.stdout + done.stderr, done.stdout + done.stderr


@pytest.mark.parametrize("clock", [None, "lockstep"], ids=["defaults", "arguments"])
def test_launch_file_starts_what_bringup_starts(domain, ros2_launch, clock, tmp_path):
    bringup = [sys.executable, "-m", "husky_bringup.bringup"]
    launch = [*ros2_launch, "husky_bringup", "husky.launch.py"]
    if clock is not None:
        file = tmp_path / "parameters.yaml"
        file.write_text(PARAMETERS)
        bringup += ["--time", clock, "--params-file", str(file), "--record", str(tmp_path / "b")]
        bringup += ["--set", "plant.body=robot_with_unit", "--remote"]
        bringup += ["--set", "plant.seed=9"]
        launch += [f"time:={clock}", f"params_file:={file}", f"record:={tmp_path / 'b'}"]
        launch += ["body:=robot_with_unit", "remote:=true", "plant.seed:=9"]
        fitted = {graph.PLANT: {"body": "robot_with_unit"}}
        specs = simulated_robot(settings=fitted, record="-", remote=True)
    else:
        specs = simulated_robot()
    seen, names = [], []
    ends = ((bringup, signal.SIGTERM, 128 + signal.SIGTERM), (launch, signal.SIGINT, 0))
    for command, number, code in ends:
        shutil.rmtree(tmp_path / "b", ignore_errors=True)
        with started(command, number, code, tmp_path / "log"), Reader() as reader:
            seen.append(reader.read(specs))
            names.append({n for n in reader.node_names() if not n.startswith("launch_ros")})
    by_bringup, by_launch = seen
    assert names[0] == names[1] == {spec.name for spec in specs}
    assert by_launch == by_bringup
    if clock is not None:
        plant = {p.name: p.value for p in by_launch[graph.PLANT].parameters}
        assert (plant["seed"], plant["terrain"], plant["friction"]) == (9, "tiles", 0.5)
        assert (plant["time"], plant["grace"]) == (clock, 2.5)

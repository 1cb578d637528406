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
from husky_description import graph

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
def started(command, number, log):
    """Run a command, end it by a signal; then it has to have ended well, with all its nodes."""
    with log.open("wb") as output:
        process = subprocess.Popen(
            command, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
    try:
        yield
        process.send_signal(number)
        assert process.wait(timeout=20.0) == 0, log.read_text()
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert "Traceback" not in log.read_text(), log.read_text()


@pytest.mark.parametrize("clock", [None, "lockstep"], ids=["defaults", "arguments"])
def test_launch_file_starts_what_bringup_starts(domain, ros2_launch, clock, tmp_path):
    bringup = [sys.executable, "-m", "husky_bringup.bringup"]
    launch = [*ros2_launch, "husky_bringup", "husky.launch.py"]
    if clock is not None:
        file = tmp_path / "parameters.yaml"
        file.write_text(PARAMETERS)
        bringup += ["--time", clock, "--params-file", str(file), "--record", str(tmp_path / "b")]
        bringup += ["--set", "plant.body=robot_with_unit", "--remote"]
        launch += [f"time:={clock}", f"params_file:={file}", f"record:={tmp_path / 'b'}"]
        launch += ["body:=robot_with_unit", "remote:=true"]
        fitted = {graph.PLANT: {"body": "robot_with_unit"}}
        specs = simulated_robot(settings=fitted, record="-", remote=True)
    else:
        specs = simulated_robot()
    seen, names = [], []
    for command, number in ((bringup, signal.SIGTERM), (launch, signal.SIGINT)):
        shutil.rmtree(tmp_path / "b", ignore_errors=True)
        with started(command, number, tmp_path / "log"), Reader() as reader:
            seen.append(reader.read(specs))
            names.append({n for n in reader.node_names() if not n.startswith("launch_ros")})
    by_bringup, by_launch = seen
    assert names[0] == names[1] == {spec.name for spec in specs}
    assert by_launch == by_bringup
    if clock is not None:
        plant = {p.name: p.value for p in by_launch[graph.PLANT].parameters}
        assert (plant["seed"], plant["terrain"], plant["friction"]) == (7, "tiles", 0.5)
        assert (plant["time"], plant["grace"]) == (clock, 2.5)

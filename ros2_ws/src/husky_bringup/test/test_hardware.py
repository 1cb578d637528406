"""Files that name a robot's devices, and what `bringup.sh --hardware` makes of them."""

import io
import re

import pytest
import yaml

from husky_bringup import bringup, hardware_check
from husky_bringup.hardware import parse_hardware, read_hardware, robot_on_hardware
from husky_drivers.probes import ProbeResult
from husky_runtime import graph

LEAST = {"drives": {"interface": "eth1"}, "vn200": {"port": "/dev/imu"}}
UNIT = {"pixhawk": {"port": "/dev/pixhawk"}, "t265": {}}
CAMERA = {"d435": {"serial_number": "7", "profile": "424x240x6", "decimation": 2}}
LEGS = {graph.DRIVE_BRIDGE, graph.VN200_DRIVER, graph.LOW_LEVEL_CONTROLLER}


def nodes(content, *settings, **options):
    hardware = parse_hardware(content)
    return {
        spec.name: spec.parameters for spec in robot_on_hardware(hardware, *settings, **options)
    }


def test_the_least_file_starts_the_legs():
    specs = nodes(LEAST)
    assert set(specs) == LEGS
    assert specs[graph.DRIVE_BRIDGE] == {
        "time": "hardware",
        "bus": "soem",
        "interface": "eth1",
        "frame_timeout": 0.002,
        "priority": 80,
    }
    assert specs[graph.VN200_DRIVER] == {"clock": "host", "port": "/dev/imu", "baud": 921600}


def test_devices_of_the_unit_bring_its_nodes():
    specs = nodes({**LEAST, **UNIT})
    assert set(specs) == LEGS | {graph.PIXHAWK_BRIDGE, graph.T265_DRIVER}
    assert specs[graph.LOW_LEVEL_CONTROLLER]["propulsion"] is True
    assert specs[graph.PIXHAWK_BRIDGE]["connection"] == "serial:/dev/pixhawk:921600"
    assert specs[graph.T265_DRIVER] == {"clock": "host", "backend": "realsense"}


def test_the_depth_camera_brings_its_driver():
    specs = nodes({**LEAST, **CAMERA})
    assert set(specs) == LEGS | {graph.D435_DRIVER}
    expected = {"clock": "host", "backend": "realsense", **CAMERA["d435"]}
    assert specs[graph.D435_DRIVER] == expected
    sim = {"backend": "sim", "port": "/tmp/d435"}
    driver = nodes({**LEAST, "d435": sim})[graph.D435_DRIVER]
    assert driver == {"clock": "host", **sim, "profile": "640x480x15", "decimation": 4}


def test_every_node_goes_by_the_wall_clock_and_none_is_of_the_simulation():
    settings = {graph.LOW_LEVEL_CONTROLLER: {"planner": True}}
    hardware = parse_hardware({**LEAST, **UNIT, **CAMERA})
    specs = robot_on_hardware(hardware, settings, "bag", console=True)
    on_the_robot = {("time", "hardware"), ("clock", "host"), ("use_sim_time", False)}
    for spec in specs:
        assert on_the_robot & set(spec.parameters.items()), spec.name
        assert spec.package != "husky_sim"
    assert {graph.PLANNER, graph.RECORDER, graph.CONSOLE} <= {spec.name for spec in specs}


def test_serial_numbers_reach_the_bridge_as_it_reads_them():
    serials = list(range(101, 113))
    drives = {**LEAST["drives"], "serial_numbers": serials}
    bridge = robot_on_hardware(parse_hardware({**LEAST, "drives": drives}))[0]
    assert bridge.parameters["serial_numbers"] == tuple(map(str, serials))
    (argument,) = (w for w in bridge.ros_arguments() if w.startswith("serial_numbers"))
    assert argument.startswith('serial_numbers:=["101", "102"')


def without(section, key):
    return {**LEAST, section: {k: v for k, v in LEAST[section].items() if k != key}}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "it holds no keys; allowed are robot, drives, vn200, pixhawk, t265"),
        ({**LEAST, "imu": {}}, "there is no key 'imu'; allowed are robot, drives"),
        ({"drives": LEAST["drives"]}, "key vn200 is missing, with port, baud"),
        (without("drives", "interface"), "key drives.interface is missing, it must be a text"),
        ({**LEAST, "vn200": "/dev/imu"}, "vn200 is '/dev/imu', it must have keys: port, baud"),
        ({**LEAST, "vn200": {"port": 3}}, "vn200.port is 3, it must be a text"),
        ({**LEAST, "vn200": {"port": ""}}, "vn200.port is '', it must be a text"),
        (
            {**LEAST, "vn200": {"port": "a", "baud": 1}},
            "vn200.baud is 1, it must be 9600 to 921600",
        ),
        ({**LEAST, "vn200": {"port": "a", "baud": True}}, "it must be a whole number"),
        ({**LEAST, "vn200": {"port": "a", "rate": 8}}, "there is no key vn200.rate; allowed are"),
        (
            {**LEAST, "drives": {"interface": "eth1", "serial_numbers": [1, 2]}},
            "drives.serial_numbers has 2 numbers, it must have 12",
        ),
        (
            {**LEAST, "drives": {"interface": "eth1", "serial_numbers": ["a"] * 12}},
            "it must be a list of whole numbers from 0",
        ),
        ({**LEAST, "pixhawk": {}}, "pixhawk needs either port or connection"),
        ({**LEAST, "t265": {"backend": "usb"}}, "t265.backend is 'usb', it must be one of"),
        ({**LEAST, "t265": {"backend": "sim"}}, "t265.port belongs to t265.backend sim"),
        ({**LEAST, "d435": {"port": "/tmp/d435"}}, "d435.port belongs to d435.backend sim"),
        ({**LEAST, "d435": {"decimation": 9}}, "d435.decimation is 9, it must be 1 to 8"),
        ({**LEAST, "robot": "beta"}, "robot is 'beta', which has no drives"),
        ({**LEAST, "robot": 1}, "robot is 1, it must be a text"),
    ],
)
def test_a_bad_file_is_refused_with_the_key_and_what_is_allowed(content, words):
    with pytest.raises(ValueError, match=re.escape(words)) as error:
        parse_hardware(content)
    assert "\n" not in str(error.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"none\.yaml: No such file"):
        read_hardware(tmp_path / "none.yaml")
    (tmp_path / "bad.yaml").write_text("drives: {")
    with pytest.raises(ValueError, match=r"bad\.yaml is no YAML"):
        read_hardware(tmp_path / "bad.yaml")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--time", "realtime"], "--time is for a simulated robot"),
        (["--bus", "sim"], "--bus is for a simulated robot"),
        (["--robot", "carbon"], "its file has the key robot"),
        (["--remote"], "--remote is for a simulated robot"),
        (["--set", "plant.terrain=tiles"], "--set plant.terrain is for a simulated robot"),
        (["--set", "wheels.radius=1"], "there is no node 'wheels'"),
    ],
)
def test_options_of_the_simulation_are_refused(tmp_path, capsys, words, said):
    file = tmp_path / "hardware.yaml"
    file.write_text(yaml.safe_dump(LEAST))
    with pytest.raises(SystemExit) as end:
        bringup.main(["--hardware", str(file), *words])
    assert end.value.code == 2 and said in capsys.readouterr().err


def test_a_dry_run_needs_a_file(capsys):
    with pytest.raises(SystemExit):
        bringup.main(["--dry-run"])
    assert "--dry-run asks the devices of --hardware FILE" in capsys.readouterr().err


def test_every_device_of_the_file_is_asked_and_told_in_a_line():
    answers = {
        "drives": ProbeResult(
            ("2 slaves answer", "knee: Gold Twitter"), "2 slaves, expected are 12"
        ),
        "vn200": ProbeResult(("VN-200, firmware 1",)),
        "pixhawk": ProbeResult((), "no autopilot is heard"),
        "t265": ProbeResult(("T265",)),
        "d435": ProbeResult((), "no D435 7 on USB"),
    }
    devices = hardware_check.devices_of(parse_hardware({**LEAST, **UNIT, **CAMERA}))
    asked = [
        device._replace(probe=lambda device=device: answers[device.name.split()[0]])
        for device in devices
    ]
    output = io.StringIO()
    missing = hardware_check.check_devices(asked, output)
    assert missing == ["drives on eth1", "pixhawk on serial:/dev/pixhawk:921600", "d435 on USB 7"]
    assert output.getvalue().splitlines() == [
        "MISSING  drives on eth1: 2 slaves, expected are 12",
        "         2 slaves answer",
        "         knee: Gold Twitter",
        "ok       vn200 on /dev/imu: VN-200, firmware 1",
        "MISSING  pixhawk on serial:/dev/pixhawk:921600: no autopilot is heard",
        "ok       t265 on USB: T265",
        "MISSING  d435 on USB 7: no D435 7 on USB",
    ]


def test_cameras_are_probed_as_the_file_says():
    cameras = {
        "t265": {"backend": "sim", "port": "/no/t265"},
        "d435": {"backend": "sim", "port": "/no/d435"},
    }
    *_, t265, d435 = hardware_check.devices_of(parse_hardware({**LEAST, **cameras}))
    assert (t265.name, d435.name) == ("t265 on /no/t265", "d435 on /no/d435")
    for device in (t265, d435):
        found, problem = device.probe()
        assert not found and "No such file" in problem
    profile = {"d435": {"profile": "640x480"}}
    *_, d435 = hardware_check.devices_of(parse_hardware({**LEAST, **profile}))
    assert "profile is '640x480', it must be WIDTHxHEIGHTxFPS" in d435.probe().problem


def test_devices_that_are_not_there_stop_the_start(tmp_path, capsys):
    file = tmp_path / "hardware.yaml"
    file.write_text(yaml.safe_dump({"drives": {"interface": "no0"}, "vn200": {"port": "/dev/no"}}))
    assert bringup.main(["--hardware", str(file), "--dry-run"]) == 1
    assert bringup.main(["--hardware", str(file)]) == 1
    told = capsys.readouterr()
    assert "MISSING  drives on no0" in told.out and "MISSING  vn200 on /dev/no" in told.out
    assert "nothing is started without drives on no0, vn200 on /dev/no" in told.err

"""compose.yaml and Dockerfile without an engine: lint, and the same nodes as bringup starts."""

import ipaddress
import os
import re
import subprocess
from pathlib import Path

import pytest
import yaml

from husky_bringup.system import simulated_robot
from husky_experiments.scenario import SCENARIOS
from husky_runtime import graph

ROOT = Path(__file__).resolve().parents[1]
DOCKER = ROOT / "docker"
PARAMETERS = ["--ros-args", "--params-file", "/run/husky/parameters.yaml"]
PROFILES = ("sim", "tools", "test", "remote", "navigation", "wire", "campaign")
NAVIGATION = (graph.D435_DRIVER, graph.ELEVATION_MAPPER, graph.LOCALIZER)
WIRE = ("wire_bridge", "wire_segment", "wire_robot", "wire_operator")
CAMPAIGN = ("campaign_scheduler", "campaign_worker", "campaign")
CAPABILITIES = {"wire_bridge": ["NET_RAW", "NET_ADMIN"], "wire_segment": ["NET_RAW"]}
"""Of the services that have any."""


def run(*command, **environment):
    result = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def composition():
    """What compose makes of the file that it finds from the root of the tree."""
    profiles = [word for profile in PROFILES for word in ("--profile", profile)]
    return yaml.safe_load(run("docker-compose", *profiles, "config", HUSKY_SCENARIO="trot"))


@pytest.fixture(scope="module")
def services(composition):
    return composition["services"]


def nodes(bus="sim", camera=False, **options):
    settings = {graph.PLANT: {"body": "robot_with_unit", "bus": bus, "camera": camera}}
    return {spec.name: spec for spec in simulated_robot(settings=settings, **options)}


def test_dockerfile_and_scripts():
    run("hadolint", "--failure-threshold", "info", str(DOCKER / "Dockerfile"))
    for script in (*DOCKER.glob("*.sh"), ROOT / "tests/docker/engine.sh"):
        assert os.access(script, os.X_OK), script
        run("bash", "-n", str(script))


def test_the_first_layer_has_what_set_up_runs():
    (line,) = re.findall(
        r"COPY.* (scripts/setup\.sh .*) scripts/$",
        (DOCKER / "Dockerfile").read_text("utf-8"),
        re.MULTILINE,
    )
    copied = {Path(name).name for name in line.split()}
    run_by_them = {
        name
        for each in copied
        for name in re.findall(r"/(\w+\.(?:sh|py))\"", (ROOT / "scripts" / each).read_text("utf-8"))
    }
    assert {"env.sh", "environment.sh", "relocate_wheels.py"} <= run_by_them <= copied


def test_compose_file_is_tidy_and_safe():
    run("yamllint", "--strict", "-c", str(ROOT / ".yamllint"), str(DOCKER / "compose.yaml"))
    rules = ("--config", str(DOCKER / ".compose-lint.yml"), "--fail-on", "low")
    run("compose-lint", *rules, str(DOCKER / "compose.yaml"))


@pytest.mark.parametrize("profile", PROFILES)
def test_every_profile_is_valid(profile):
    run("docker-compose", "--profile", profile, "config", "--quiet")


def ros2_run(spec):
    return ["ros2", "run", spec.package, spec.executable]


def test_one_service_for_each_node_of_the_system(services):
    """Parameters are in the file that every node reads; here is only which node it is."""
    specs = nodes(remote=True, camera=True)
    found = {name: service for name, service in services.items() if name in specs}
    assert set(found) == set(specs)
    for name, spec in specs.items():
        assert found[name]["command"] == ros2_run(spec) + PARAMETERS, name
    others = set(services) - set(specs)
    assert others == {"operator", "test", "tools", graph.RECORDER, *WIRE, *CAMPAIGN}
    recorder = nodes(record="x")[graph.RECORDER]
    assert services[graph.RECORDER]["command"] == ros2_run(recorder)


def test_profiles(services):
    for name in nodes():
        assert set(services[name]["profiles"]) == {"sim", "test"}, name
    assert services[graph.RC_TRANSMITTER]["profiles"] == ["remote"]
    for name in NAVIGATION:
        assert services[name]["profiles"] == ["navigation"], name
    assert services["operator"]["profiles"] == ["sim"]
    assert services["test"]["profiles"] == ["test"]
    assert services["tools"]["profiles"] == services[graph.RECORDER]["profiles"] == ["tools"]
    for profile, names in (("wire", WIRE), ("campaign", CAMPAIGN)):
        for name in names:
            assert services[name]["profiles"] == [profile], name


def test_whoever_needs_the_robot_waits_until_all_of_it_is_healthy(services):
    wanted = {name: "service_healthy" for name in nodes()}
    for name in ("operator", "test"):
        waits = {other: how["condition"] for other, how in services[name]["depends_on"].items()}
        assert waits == wanted, name
    assert services["operator"]["command"] == ["scenario", "trot"]
    assert services["test"]["command"][1] in SCENARIOS


def test_every_container_is_confined(services):
    for name, service in services.items():
        assert service["read_only"] is True, name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert service["mem_limit"] and service["pids_limit"] and service["cpus"], name
        assert service.get("cap_add", []) == CAPABILITIES.get(name, []), name
        networks = {"campaign"} if name in CAMPAIGN else {"robot"}
        networks |= {"ethercat"} if name in CAPABILITIES else set()
        assert set(service["networks"]) == networks, name
        assert service.get("user", "") == ("0:8000" if name in CAPABILITIES else ""), name
        assert "privileged" not in service and "ports" not in service, name
        mounts = {mount["type"] for mount in service.get("volumes", [])}
        assert mounts <= {"volume"}, f"{name} sees files of the host"


def test_every_node_runs_once_in_the_profile_with_frames(services):
    """The drives and their master by themselves, all others in one container."""
    specs, ours = nodes("soem"), {}
    for service, name in (
        ("wire_bridge", graph.DRIVE_BRIDGE),
        ("wire_segment", graph.DRIVE_SEGMENT),
    ):
        assert services[service]["command"] == ros2_run(specs[name]) + PARAMETERS
        ours[service] = name
    command = services["wire_robot"]["command"]
    assert command[0] == "bringup"
    assert sorted(command[1:]) == sorted(["--without"] * len(ours) + list(ours.values()))
    for name in WIRE:
        assert "plant.bus=soem" in services[name]["environment"]["HUSKY_SETTINGS"].split(), name
    waits = services["wire_operator"]["depends_on"]
    assert set(waits) == set(WIRE) - {"wire_operator"}
    assert {how["condition"] for how in waits.values()} == {"service_healthy"}


def test_frames_pass_between_two_containers_alone(composition, services):
    """A private network with a fixed address for each end; nodes find its interface by it."""
    network = composition["networks"]["ethercat"]
    assert network["driver"] == "macvlan", "a Linux bridge drops frames of SOEM"
    assert network["internal"] is True
    subnet = ipaddress.ip_network(network["ipam"]["config"][0]["subnet"])
    ends = [services[name]["networks"]["ethercat"]["ipv4_address"] for name in CAPABILITIES]
    assert len(set(ends)) == 2 and {ipaddress.ip_address(end) in subnet for end in ends} == {True}
    for name in CAPABILITIES:
        told = services[name]["environment"]["HUSKY_ETHERCAT"]
        assert ipaddress.ip_address(told) == subnet.network_address, name


def test_no_second_master(composition, services):
    """The engine gives an address and a name once: also the name of the other profile's master."""
    bridge = services["wire_bridge"]
    assert bridge["networks"]["ethercat"]["ipv4_address"]
    assert bridge["container_name"] == f"{composition['name']}-{graph.DRIVE_BRIDGE}-1"


def test_workers_and_the_program_of_a_campaign_meet(services):
    """At the scheduler's address, and in one directory: the one where results are by default."""
    scheduler, workers, program = (services[name] for name in CAMPAIGN)
    port = scheduler["command"][scheduler["command"].index("--port") + 1]
    for service in (workers, program):
        assert f"tcp://campaign_scheduler:{port}" in service["command"]
        mounts = {mount["source"]: mount["target"] for mount in service["volumes"]}
        assert mounts["campaigns"] == "/opt/husky/out/campaigns"
    assert workers["scale"] == 2
    assert (ROOT / program["command"][1]).is_file()
    waits = {other: how["condition"] for other, how in program["depends_on"].items()}
    assert waits == dict.fromkeys(CAMPAIGN[:2], "service_healthy")


@pytest.mark.parametrize(("network", "code"), [("127.0.0.0", 0), ("192.0.2.0", 1)])
def test_the_entry_point_finds_the_interface(tmp_path, network, code):
    """A copy with this tree in place of the image's, and a routing table of its own."""
    routes = tmp_path / "route"
    routes.write_text("Iface\tDestination\tGateway\neth0\t00000000\t010012AC\neth1\t0000007F\t0\n")
    entry = (DOCKER / "entrypoint.sh").read_text("utf-8")
    script = tmp_path / "entrypoint.sh"
    script.write_text(
        entry.replace("/opt/husky", str(ROOT)).replace("/proc/net/route", str(routes))
    )
    parameters = tmp_path / "parameters.yaml"
    told = {
        "HUSKY_ETHERCAT": network,
        "HUSKY_TIME": "lockstep",
        "HUSKY_SETTINGS": "plant.bus=soem",
        "HUSKY_PARAMETERS": str(parameters),
    }
    done = subprocess.run(
        ["bash", str(script), "true"],
        env={**os.environ, **told},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == code, done.stderr
    if code:
        assert done.stderr == f"error: no network interface leads into HUSKY_ETHERCAT={network}\n"
        return
    written = yaml.safe_load(parameters.read_text("utf-8"))
    for name in (graph.DRIVE_BRIDGE, graph.DRIVE_SEGMENT):
        assert written[name]["ros__parameters"]["interface"] == "eth1", name


def test_the_environment_says_domain_time_and_settings(services):
    wanted = {"ROS_DOMAIN_ID", "HUSKY_TIME", "HUSKY_SETTINGS"}
    for name, service in services.items():
        if name not in CAMPAIGN:  # a run is what its file says
            assert wanted <= set(service["environment"]), name


def test_the_wires_are_where_drivers_look(services):
    """The directory of `graph.serial_port`, and one set of terminals for all who share it."""
    domain = int(services[graph.PLANT]["environment"]["ROS_DOMAIN_ID"])
    directory = str(Path(graph.serial_port("vn200", domain)).parent)
    for name in nodes(remote=True, camera=True):
        mounts = {mount["target"]: mount["source"] for mount in services[name]["volumes"]}
        assert mounts[directory] == "wires", name
        assert mounts["/dev/pts"] == "terminals", name

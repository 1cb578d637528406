"""compose.yaml and Dockerfile without an engine: lint, and the same nodes as bringup starts."""

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
PROFILES = ("sim", "tools", "test", "remote")


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


def nodes(**options):
    body = {graph.PLANT: {"body": "robot_with_unit"}}
    return {spec.name: spec for spec in simulated_robot(settings=body, **options)}


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
    specs = nodes(remote=True)
    found = {name: service for name, service in services.items() if name in specs}
    assert set(found) == set(specs)
    for name, spec in specs.items():
        assert found[name]["command"] == ros2_run(spec) + PARAMETERS, name
    others = set(services) - set(specs)
    assert others == {"operator", "test", "tools", graph.RECORDER}
    recorder = nodes(record="x")[graph.RECORDER]
    assert services[graph.RECORDER]["command"] == ros2_run(recorder)


def test_profiles(services):
    for name in nodes():
        assert set(services[name]["profiles"]) == {"sim", "test"}, name
    assert services[graph.RC_TRANSMITTER]["profiles"] == ["remote"]
    assert services["operator"]["profiles"] == ["sim"]
    assert services["test"]["profiles"] == ["test"]
    assert services["tools"]["profiles"] == services[graph.RECORDER]["profiles"] == ["tools"]


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
        assert list(service["networks"]) == ["robot"], name
        assert "privileged" not in service and "ports" not in service, name
        mounts = {mount["type"] for mount in service.get("volumes", [])}
        assert mounts <= {"volume"}, f"{name} sees files of the host"


def test_the_environment_says_domain_time_and_settings(services):
    wanted = {"ROS_DOMAIN_ID", "HUSKY_TIME", "HUSKY_SETTINGS"}
    for name, service in services.items():
        assert wanted <= set(service["environment"]), name


def test_the_wires_are_where_drivers_look(services):
    """The directory of `graph.serial_port`, and one set of terminals for all who share it."""
    domain = int(services[graph.PLANT]["environment"]["ROS_DOMAIN_ID"])
    directory = str(Path(graph.serial_port("vn200", domain)).parent)
    for name in nodes(remote=True):
        mounts = {mount["target"]: mount["source"] for mount in services[name]["volumes"]}
        assert mounts[directory] == "wires", name
        assert mounts["/dev/pts"] == "terminals", name

import pytest

from husky_bringup import system
from husky_bringup.system import NodeSpec, simulated_robot, to_yaml
from husky_description.mujoco_model import flying_inertia
from husky_description.robot import ROBOTS, load_robot
from husky_runtime import graph

LEGS = {graph.DRIVE_BRIDGE, graph.VN200_DRIVER, graph.LOW_LEVEL_CONTROLLER}
FANS = {graph.FLIGHT_CONTROLLER, graph.PIXHAWK_BRIDGE, graph.T265_DRIVER}


def nodes(body, **options):
    return {
        spec.name: spec
        for spec in simulated_robot(settings={graph.PLANT: {"body": body}}, **options)
    }


@pytest.mark.parametrize(
    ("body", "expected"),
    [("robot", LEGS), ("robot_with_unit", LEGS | FANS), ("unit", FANS)],
)
def test_the_body_decides_who_takes_part(body, expected):
    assert set(nodes(body)) == {graph.PLANT} | expected
    assert (
        set(nodes(body, remote=True, record="x", console=True))
        == {
            graph.PLANT,
            graph.RC_TRANSMITTER,
            graph.RECORDER,
            graph.CONSOLE,
        }
        | expected
    )


def test_everybody_has_the_same_clock():
    for spec in nodes("robot_with_unit", time="realtime", remote=True).values():
        assert spec.parameters.get("time", "realtime") == "realtime", spec.name


def test_the_controller_uses_fans_only_where_there_are_some():
    controller = graph.LOW_LEVEL_CONTROLLER
    assert "propulsion" not in nodes("robot")[controller].parameters
    assert nodes("robot_with_unit")[controller].parameters["propulsion"] is True


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_depth_camera_comes_with_its_driver_and_with_navigation(robot):
    settings = {graph.PLANT: {"camera": True, "robot": robot}}
    without = {graph.PLANT: {"camera": False, "robot": robot}}
    names = [spec.name for spec in simulated_robot(settings=settings)]
    blind = [spec.name for spec in simulated_robot(settings=without)]
    seeing = graph.D435_DRIVER, graph.ELEVATION_MAPPER, graph.LOCALIZER, graph.NAVIGATOR
    assert [*blind, *seeing] == names


def test_bad_body_and_node():
    with pytest.raises(ValueError, match="body is 'bird'"):
        nodes("bird")
    with pytest.raises(ValueError, match="camera is true, but body is 'unit'"):
        simulated_robot(settings={graph.PLANT: {"body": "unit", "camera": True}})
    with pytest.raises(ValueError, match="no node 'drive_bridge'"):
        simulated_robot(settings={graph.PLANT: {"body": "unit"}, graph.DRIVE_BRIDGE: {}})


@pytest.mark.parametrize(
    ("value", "text"),
    [(True, "true"), (1.0, "1.0"), ("a", '"a"'), ("", '""'), ((0.1, 2.0), "[0.1, 2.0]")],
)
def test_values_keep_their_types(value, text):
    assert to_yaml(value) == text


def test_flying_inertia_is_that_of_pinocchio():
    """The composite inertia of the standing robot about its centre of mass, from the URDF."""
    pinocchio = pytest.importorskip("pinocchio")
    import numpy as np

    from husky_description.urdf import build_urdf

    robot = load_robot()
    model = pinocchio.buildModelFromXML(build_urdf(robot), pinocchio.JointModelFreeFlyer())
    data = model.createData()
    q = pinocchio.neutral(model)
    for name, angle in zip(robot.joint_names, robot.stand_joint_position, strict=True):
        q[model.joints[model.getJointId(name)].idx_q] = angle
    pinocchio.ccrba(model, data, q, np.zeros(model.nv))
    assert np.diag(data.Ig.inertia) == pytest.approx(flying_inertia(robot, "robot"), abs=2e-4)


def test_everybody_knows_how_the_fans_are_mounted():
    settings = {graph.PLANT: {"body": "robot_with_unit", "mounting": "vectoring"}}
    told = {
        spec.name for spec in simulated_robot(settings=settings) if "mounting" in spec.parameters
    }
    assert told == {
        graph.PLANT,
        graph.LOW_LEVEL_CONTROLLER,
        graph.FLIGHT_CONTROLLER,
        graph.PIXHAWK_BRIDGE,
    }
    fixed = simulated_robot(settings={graph.PLANT: {"body": "robot_with_unit"}})
    assert not any("mounting" in spec.parameters for spec in fixed)


def test_beta_has_a_servo_bridge_and_no_propulsion_unit():
    names = {spec.name for spec in simulated_robot(settings={graph.PLANT: {"robot": "beta"}})}
    assert graph.SERVO_BRIDGE in names and graph.DRIVE_BRIDGE not in names
    with pytest.raises(ValueError, match="body is 'unit': of husky_beta there are robot"):
        simulated_robot(settings={graph.PLANT: {"robot": "beta", "body": "unit"}})
    with pytest.raises(ValueError, match="robot is 'gamma', it must be one of carbon, beta"):
        simulated_robot(settings={graph.PLANT: {"robot": "gamma"}})


def test_drives_behind_frames_have_a_node_of_their_own():
    for bus in graph.BUSES:
        specs = {spec.name: spec for spec in simulated_robot(settings={graph.PLANT: {"bus": bus}})}
        assert (graph.DRIVE_SEGMENT in specs) == (bus == "soem")
        assert specs[graph.DRIVE_BRIDGE].parameters["bus"] == bus
    with pytest.raises(ValueError, match="bus is 'can', it must be one of sim, soem"):
        simulated_robot(settings={graph.PLANT: {"bus": "can"}})
    with pytest.raises(ValueError, match="bus is 'soem': husky_beta has servos, no drives"):
        simulated_robot(settings={graph.PLANT: {"bus": "soem", "robot": "beta"}})


def test_every_robot_has_its_nodes():
    assert set(system._NODES) == {load_robot(name).actuation for name in ROBOTS}


def test_the_default_robot_is_told_to_nobody_and_another_to_all_who_load_it():
    default = simulated_robot(settings={graph.PLANT: {"body": "robot_with_unit"}})
    assert not any("robot" in spec.parameters for spec in default)
    for robot in ROBOTS[1:]:
        settings = {graph.PLANT: {"robot": robot, "body": "robot_with_unit"}}
        settings[graph.LOW_LEVEL_CONTROLLER] = {"planner": True}
        specs = simulated_robot(settings=settings)
        assert all(spec.parameters["robot"] == robot for spec in specs)


def test_a_robot_of_a_file_has_the_nodes_of_its_kind(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ROBOTS:
        tmp_path.joinpath("mine.yaml").write_text(load_robot(name).parameters)
        mine, known = (
            simulated_robot(settings={graph.PLANT: {"robot": robot, "body": "robot_with_unit"}})
            for robot in ("mine.yaml", name)
        )
        assert [spec.name for spec in mine] == [spec.name for spec in known]
        where = str(tmp_path / "mine.yaml")
        assert all(spec.parameters["robot"] == where for spec in mine)


@pytest.mark.parametrize(
    ("spec", "told"),
    [
        (NodeSpec("husky_nowhere", "plant"), "package husky_nowhere is not installed"),
        (NodeSpec("husky_sim", "plantt"), "plantt of husky_sim is not installed"),
    ],
)
def test_a_node_that_is_not_installed_is_named(spec, told):
    pytest.importorskip("ament_index_python")
    with pytest.raises(ValueError, match=told):
        spec.command()

import pytest
import yaml

from husky_bringup.parameter_file import main, parameter_file
from husky_bringup.system import NodeSpec, simulated_robot


def test_the_file_says_what_the_command_lines_say():
    specs = simulated_robot("realtime", {"plant": {"body": "robot_with_unit", "seed": 3}})
    read = yaml.safe_load(parameter_file(specs))
    told = {name: node["ros__parameters"] for name, node in read.items()}
    wanted = {
        spec.name: {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in spec.parameters.items()
        }
        for spec in specs
    }
    assert told == wanted


def test_rcl_reads_it_with_the_same_types(tmp_path):
    """As a node that is given the file."""
    rclpy = pytest.importorskip("rclpy")
    values = {"text": "a/b", "empty": "", "flag": True, "inner.number": 1.0, "list": (0.1, 2.0)}
    path = tmp_path / "parameters.yaml"
    path.write_text(parameter_file([NodeSpec("p", "listener", values)]))
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", "--params-file", str(path)], context=context)
    try:
        node = rclpy.create_node(
            "listener", context=context, automatically_declare_parameters_from_overrides=True
        )
        for name, value in values.items():
            found = node.get_parameter(name).value
            assert (tuple(found) if isinstance(value, tuple) else found) == value, name
        node.destroy_node()
    finally:
        rclpy.shutdown(context=context)


def test_a_node_without_parameters_is_left_out():
    assert parameter_file([NodeSpec("p", "silent")]) == ""


def test_command_line(capsys):
    assert main(["--time", "lockstep", "--set", "plant.seed=7", "--remote"]) == 0
    read = yaml.safe_load(capsys.readouterr().out)
    assert read["plant"]["ros__parameters"] == {"time": "lockstep", "seed": 7}
    assert "rc_transmitter" in read


def test_a_setting_of_no_node_is_refused(capsys):
    with pytest.raises(SystemExit):
        main(["--set", "bird.seed=7"])
    assert "no node 'bird'" in capsys.readouterr().err

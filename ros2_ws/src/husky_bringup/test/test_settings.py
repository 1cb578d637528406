"""Parameters from the command line, as rcl itself reads them."""

import argparse
import math

import pytest

from husky_bringup.settings import collect, nodes_of_file, parse_setting, read_value
from husky_bringup.system import NodeSpec, to_yaml

VALUES = (
    *("5e-1", "1e3", "1.", ".5", "+2", "-3", "0", "0x1F", "-0x1f", "017", "08", "9" * 19),
    *("inf", ".inf", "-.inf", ".nan", "1_000", "1e", "0b1", "1:30", "2026-11-28", "~", "null"),
    *("true", "True", "TRUE", "tRue", "yes", "No", "on", "Off", "y", "N"),
    *("flat", "two words", "'true'", '"5"', "'it''s'", "ümlaut", "a:b", "a#b", "/tmp/x"),
)
TEXTS = (
    *("", "on", "no", "5", "0x10", "1e5", "null", "~", "@x", "a: b", "a #b", "-", "*x", "&x", "!x"),
    *("%x", "it's", 'a "quoted" one', "back\\slash", "\\n", " both ends ", "two\nlines", "tab\t"),
    *("ü", "[1", "{"),
)


@pytest.fixture(scope="module")
def read_by_rcl():
    """Return what a node gets of a list of values, each behind `-p NAME:=`."""
    rclpy = pytest.importorskip("rclpy")

    def read(words):
        arguments = ["--ros-args"]
        for index, word in enumerate(words):
            arguments += ["-p", f"x{index}:={word}"]
        context = rclpy.Context()
        rclpy.init(context=context, args=arguments)
        try:
            node = rclpy.create_node(
                "read",
                context=context,
                automatically_declare_parameters_from_overrides=True,
                start_parameter_services=False,
                enable_rosout=False,
            )
            values = [node.get_parameter(f"x{index}").value for index in range(len(words))]
            node.destroy_node()
            return values
        finally:
            rclpy.shutdown(context=context)

    return read


def same(a, b):
    both_nan = isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b)
    return both_nan or (type(a) is type(b) and a == b)


def test_values_are_read_as_rcl_reads_them(read_by_rcl):
    ours = [read_value(text) for text in VALUES]
    theirs = read_by_rcl(VALUES)
    differing = [row for row in zip(VALUES, ours, theirs, strict=True) if not same(*row[1:])]
    assert not differing


def test_values_are_written_so_that_rcl_reads_them_back(read_by_rcl):
    values = [*TEXTS, True, False, 3, -1, 0.5, 1e-12, math.inf, math.nan, 2**40]
    theirs = read_by_rcl([to_yaml(value) for value in values])
    differing = [row for row in zip(values, theirs, strict=True) if not same(*row)]
    assert not differing


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("plant", "'plant' is not NODE.PARAMETER=VALUE"),
        ("plant.seed", "is not NODE.PARAMETER=VALUE"),
        ("plant.seed=", "plant.seed: '' is no number, text, true or false"),
        ("plant.seed=[1, 2]", "plant.seed: '[1, 2]' is no number"),
        (f"plant.seed={'9' * 400}", "plant.seed: 99999999999999999999... is too large a number"),
        ("plant.terrain='flat", "'flat begins with a quote and does not end with one"),
    ],
)
def test_what_is_no_setting_is_refused_by_name(text, words):
    with pytest.raises(argparse.ArgumentTypeError) as error:
        parse_setting(text)
    assert words in str(error.value)


def test_settings_are_collected_by_node():
    given = map(parse_setting, ("a.x=1", "b.y.z=on", "a.w='1'", "a.x=2.0"))
    assert collect(list(given)) == {"a": {"x": 2.0, "w": "1"}, "b": {"y.z": True}}


def test_a_directory_named_as_a_truth_value_stays_a_text():
    spec = NodeSpec("husky_bringup", "recorder", {"output": "on"})
    assert spec.ros_arguments() == ["-p", 'output:="on"']


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "No such file or directory"),
        (b"", "is empty: a parameter file has NODE: {ros__parameters"),
        (b"- 1\n", "has no nodes"),
        (b"plant: {seed: 1}\n", "plant has no ros__parameters"),
        (b"plant: [\n", "is no YAML in UTF-8"),
        ("plant: {ros__parameters: {x: ü}}\n".encode("latin-1"), "is no YAML in UTF-8"),
    ],
)
def test_what_is_no_parameter_file_is_refused_in_one_line(tmp_path, content, words):
    file = tmp_path / "robot.yaml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ValueError, match=r"robot\.yaml") as error:
        nodes_of_file(file)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_parameter_files_with_umlauts_and_namespaces_are_taken(tmp_path):
    file = tmp_path / "robot.yaml"
    text = "/**: {ros__parameters: {x: 1}}\nfleet: {räuber: {ros__parameters: {}}}\n"
    file.write_text(text + "/robot1/plant: {ros__parameters: {x: 1}}\n", "utf-8")
    assert nodes_of_file(file) == {"räuber", "plant"}

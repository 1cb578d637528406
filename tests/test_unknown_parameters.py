"""Parameters that are given to a node and that it does not have."""

import pytest

pytest.importorskip("rclpy")

from node_bench import assert_refused

from husky_runtime.nodes.unknown_parameters import given, like

FILE = """
/**:
  ros__parameters: {of_somebody: 1}
plant:
  ros__parameters: {terrain: flat, gait: {trot: {period: 0.3}}}
/planner:
  ros__parameters: {cache: x}
/robot1/planner:
  ros__parameters: {of_another: x}
"""


@pytest.mark.parametrize(
    ("words", "names"),
    [
        ("", []),
        ("-p early:=1", []),
        ("--ros-args -p a:=1 -p b.c:=x", ["a", "b.c"]),
        ("--ros-args --param plant:a:=1 -p planner:b:=2", ["a"]),
        ("--ros-args -r x:=y -- -p c:=1", []),
        ("--ros-args --params-file FILE", ["terrain", "gait.trot.period"]),
    ],
)
def test_what_is_given(words, names, tmp_path):
    path = tmp_path / "file.yaml"
    path.write_text(FILE)
    arguments = words.replace("FILE", str(path)).split()
    assert list(given("plant", "/", arguments)) == names


def test_sections_of_a_node_by_its_full_name(tmp_path):
    path = tmp_path / "file.yaml"
    path.write_text(FILE)
    arguments = ["--ros-args", "--params-file", str(path)]
    assert list(given("planner", "/", arguments)) == ["cache"]
    assert list(given("planner", "/robot1", arguments)) == ["of_another"]


KNOWN = ["gait.trot.period", "gait.trot.swing_height", "assist.slew", "walk.late_limit", "body"]


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("gait.step_height", ["gait.trot.swing_height", "gait.trot.period"]),
        ("asist.slew", ["assist.slew"]),
        ("slew", ["assist.slew"]),
        ("trot.period", ["gait.trot.period"]),
        ("bodi", ["body"]),
        ("nothing_of_it", sorted(KNOWN)),
    ],
)
def test_names_that_may_have_been_meant(name, near):
    assert like(name, KNOWN) == near


@pytest.mark.graph
def test_a_node_that_is_given_what_it_does_not_have_says_what_is_like_it(domain):
    words = "there is no parameter perod; there is period"
    assert_refused("husky_pu.nodes.rc_transmitter", words, perod=0.014)

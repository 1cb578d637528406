"""Tables of the documents: what is generated, what is kept, what is refused."""

import pytest

pytest.importorskip("rclpy")

from husky_bringup import document
from husky_bringup.interfaces import Interface
from husky_bringup.node_parameter import NodeParameter
from husky_control.modes.table import TRANSITIONS, Mode
from husky_runtime import graph

SPEED = NodeParameter("speed", 0.5, "forward speed [m/s], at most", 0.0, 2.0, False, "")
GAIN = NodeParameter("gait.trot.gain", 3.0, "A gain (trot; live) [1/s]", 0.0, 4.0, False, "")
PORT = NodeParameter("port", graph.serial_port("x", 85), "serial | port", None, None, True, "")
ROBOT = Interface(
    name="robot",
    package="husky_x",
    lifecycle=False,
    publishes=(("/a", "p/msg/A"), ("/b", "p/msg/B")),
    subscribes=(("/c", "p/msg/C"),),
    offers=(("/s", "p/srv/S"),),
    calls=(),
    parameters=(SPEED, GAIN, PORT),
)
OTHER = Interface("other", "husky_x", True, (("/c", "p/msg/C"),), (("/a", "p/msg/A"),), (), ())
NODES = {"robot": ROBOT, "other": OTHER}


def block(name: str, body: str = "") -> str:
    return f"before\n<!-- begin {name} -->\n{body}<!-- end -->\nafter\n"


def test_hand_written_column_is_kept_and_stale_rows_go():
    old = (
        "| publishes | `/b` | `p/msg/Wrong` | said \\| by hand |\n"
        "| publishes | `/gone` | `p/msg/X` | no more |\n"
    )
    new = document.rewrite(block("interface robot", old), NODES)
    assert new.startswith("before\n") and new.endswith("after\n")
    assert "| publishes | `/b` | `p/msg/B` | said \\| by hand |" in new
    assert "| publishes | `/a` | `p/msg/A` |  |" in new
    assert "/gone" not in new
    assert document.rewrite(new, NODES) == new


def test_parameters_have_unit_range_and_default():
    new = document.rewrite(block("parameters robot"), NODES)
    assert "| `speed` | 0.5 | m/s | 0 to 2 | yes | forward speed, at most |" in new
    assert "| `port` | `/tmp/husky-<ROS_DOMAIN_ID>/x` |  |  |  | serial \\| port |" in new
    assert "gait" not in new


def test_gaits_are_columns():
    new = document.rewrite(block("gaits robot"), NODES)
    assert "| parameter | trot | unit | meaning |" in new
    assert "| `gait.<gait>.gain` | 3.0 (0 to 4) | 1/s | A gain |" in new


@pytest.mark.parametrize("name", ["interface nobody", "nothing", "nodes robot"])
def test_an_unknown_table_is_refused(name):
    with pytest.raises(ValueError, match=name):
        document.rewrite(block(name), NODES)


def test_graph_is_drawn_from_who_hears_whom():
    edges = document.graph_drawing(NODES)
    assert '    robot -- "/a" --> other' in edges
    assert '    other -- "/c" --> robot' in edges
    assert not any("/b" in edge for edge in edges), "nobody hears /b"


def test_every_transition_is_drawn():
    lines = document.mode_drawing()
    arrows = [line for line in lines if "-->" in line and "[*]" not in line]
    assert len(arrows) == len(TRANSITIONS)
    for mode in Mode:
        assert any(f"--> {mode.value}:" in line for line in arrows), mode
    assert not any(";" in line for line in lines)

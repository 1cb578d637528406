"""tf2_msgs, built where ROS lacks it: Jazzy's own type for every client, and never in its way."""

import json
import os
import subprocess
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from rosbags.typesys import Stores, get_typestore

ROOT = Path(__file__).resolve().parents[1]
JAZZY = {
    "msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "msg/TF2Error": "db2485e7d6a0ec75bf087e058ee45df682acc3a621ca7780503d10aac141809a",
    "srv/FrameGraph": "0d1fbc6222c018ba5f33822904a2fdd4063705289956d3fdde07cd8c50fe8067",
    "action/LookupTransform": "0b8adf6bc0b5958879e3265b41a457e03558fe523890a81252c70eba97a82c5d",
}
"""What the genuine package tells on the network (RIHS01), so that any client fits."""


@pytest.mark.parametrize("name", JAZZY)
def test_the_type_is_jazzys(name):
    """A genuine client compares this hash; `tf2_ros` imports all of these."""
    share = Path(get_package_share_directory("tf2_msgs"))
    told = json.loads((share / f"{name}.json").read_text("utf-8"))
    hashes = {each["type_name"]: each["hash_string"] for each in told["type_hashes"]}
    assert hashes[f"tf2_msgs/{name}"] == f"RIHS01_{JAZZY[name]}"


@pytest.mark.parametrize("name", ["msg/TFMessage", "msg/TF2Error"])
def test_an_independent_reader_computes_the_same(name):
    """rosbags, from its own definitions."""
    hashed = get_typestore(Stores.ROS2_JAZZY).hash_rihs01(f"tf2_msgs/{name}")
    assert hashed == f"RIHS01_{JAZZY[name]}"


@pytest.fixture
def lacking():
    """Asks setup.sh's function what is lacking beside some prefixes of ROS."""
    text = (ROOT / "scripts/setup.sh").read_text("utf-8")
    begin = text.index("lacking_interfaces() {")
    function = text[begin : text.index("\n}\n", begin) + 3]

    def ask(*prefixes: Path) -> str:
        script = f'set -euo pipefail; workspace="{ROOT}/ros2_ws"; {function} lacking_interfaces'
        path = ":".join(map(str, prefixes))
        env = {"PATH": os.environ["PATH"], "AMENT_PREFIX_PATH": path}
        return subprocess.run(
            ["bash", "-c", script], env=env, capture_output=True, text=True, check=True
        ).stdout

    return ask


def test_an_installed_one_is_never_shadowed(tmp_path, lacking):
    own, ros, other = ROOT / "ros2_ws/install", tmp_path / "jazzy", tmp_path / "other"
    other.mkdir()
    assert lacking(own, other) == "underlay/tf2_msgs "
    index = ros / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    (index / "tf2_msgs").touch()
    assert lacking(own, ros, other) == lacking(own, other, ros) == ""
    # Nor does a plain `colcon build` in the workspace find it.
    assert (ROOT / "ros2_ws/underlay/COLCON_IGNORE").exists()


def test_it_is_found_where_it_was_built_or_installed():
    """In this workspace only if no other ROS here has it."""
    prefix = Path(get_package_prefix("tf2_msgs"))
    others = [Path(p) for p in os.environ["AMENT_PREFIX_PATH"].split(":") if p]
    have = [
        p for p in others if (p / "share/ament_index/resource_index/packages/tf2_msgs").exists()
    ]
    assert have == [prefix]

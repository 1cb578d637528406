"""Interfaces built where ROS lacks them: Jazzy's own types for every client, never in its way."""

import json
import os
import subprocess
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROOT = Path(__file__).resolve().parents[1]
JAZZY = {
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "tf2_msgs/msg/TF2Error": "db2485e7d6a0ec75bf087e058ee45df682acc3a621ca7780503d10aac141809a",
    "tf2_msgs/srv/FrameGraph": "0d1fbc6222c018ba5f33822904a2fdd4063705289956d3fdde07cd8c50fe8067",
    "tf2_msgs/action/LookupTransform": "0b8adf6bc0b5958879e3265b41a457e03558fe523890a81252c70eba97a82c5d",  # noqa: E501
    "nav2_msgs/msg/MissedWaypoint": "cc79d1e3a1b86cd6a80788b16c844c396932462560936293011f062c21b82ed1",  # noqa: E501
    "nav2_msgs/action/ComputePathToPose": "b11d50c914791956069419b8f4ad441e3c66fcfbd9461f8e87110b77dc6febe9",  # noqa: E501
    "nav2_msgs/action/FollowPath": "9d95513552fb578cfb933d7e0160273911269cbdf4b348f1acb87d8a903b13cf",  # noqa: E501
    "nav2_msgs/action/FollowWaypoints": "09e36a19e0374ab692e78b877e3345daa223ca4186b8af90f77939b78c6e6d7b",  # noqa: E501
    "nav2_msgs/action/NavigateThroughPoses": "4e680a34fd27772095da6ffdb32ae348adbc3d948248d38cf8d5ca3fc7a3a6c4",  # noqa: E501
    "nav2_msgs/action/NavigateToPose": "a56dba8a3234a1215e610180dc703ae25bbf406dded8b54887891c9732857eab",  # noqa: E501
}
"""Hashes of the genuine types as told on the network (RIHS01), so that any client fits."""
UNDERLAY = ROOT / "ros2_ws/underlay"
LACKING = sorted(each.parent.name for each in UNDERLAY.glob("*/package.xml"))


@pytest.mark.parametrize("name", JAZZY)
def test_the_type_is_jazzys(name):
    """A genuine client compares this hash; `tf2_ros` imports all of these."""
    assert told_hash(name) == f"RIHS01_{JAZZY[name]}"


def told_hash(name: str) -> str:
    """Return the hash that the installed package tells of a type."""
    package, kind = name.split("/", 1)
    share = Path(get_package_share_directory(package))
    told = json.loads((share / f"{kind}.json").read_text("utf-8"))
    hashes = {each["type_name"]: each["hash_string"] for each in told["type_hashes"]}
    return hashes[name]


@pytest.mark.parametrize("name", ["tf2_msgs/msg/TFMessage", "tf2_msgs/msg/TF2Error"])
def test_an_independent_reader_computes_the_same(name):
    """rosbags, from its own definitions."""
    hashed = get_typestore(Stores.ROS2_JAZZY).hash_rihs01(name)
    assert hashed == f"RIHS01_{JAZZY[name]}"


def test_a_grid_map_has_the_fields_of_grid_map():
    """grid_map_msgs 2.2.1, in its order: names and types make the hash, comments do not."""
    store = get_typestore(Stores.ROS2_JAZZY)
    info = "float64 resolution\nfloat64 length_x\nfloat64 length_y\ngeometry_msgs/Pose pose"
    layers = "string[] layers\nstring[] basic_layers\nstd_msgs/Float32MultiArray[] data"
    starts = "uint16 outer_start_index\nuint16 inner_start_index"
    whole = f"std_msgs/Header header\ngrid_map_msgs/GridMapInfo info\n{layers}\n{starts}"
    store.register(get_types_from_msg(info, "grid_map_msgs/msg/GridMapInfo"))
    store.register(get_types_from_msg(whole, "grid_map_msgs/msg/GridMap"))
    for name in ("grid_map_msgs/msg/GridMapInfo", "grid_map_msgs/msg/GridMap"):
        assert told_hash(name) == store.hash_rihs01(name)


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
    assert lacking(own, other) == "".join(f"underlay/{name} " for name in LACKING)
    index = ros / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    for name in LACKING:
        (index / name).touch()
    assert lacking(own, ros, other) == lacking(own, other, ros) == ""
    # Nor does a plain `colcon build` in the workspace find it.
    assert (UNDERLAY / "COLCON_IGNORE").exists()


@pytest.mark.parametrize("package", LACKING)
def test_it_is_found_where_it_was_built_or_installed(package):
    """In this workspace only if no other ROS here has it."""
    prefix = Path(get_package_prefix(package))
    others = [Path(p) for p in os.environ["AMENT_PREFIX_PATH"].split(":") if p]
    index = "share/ament_index/resource_index/packages"
    have = [each for each in others if (each / index / package).exists()]
    assert have == [prefix]

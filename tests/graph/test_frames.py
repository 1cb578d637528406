"""The tree of frames, the odometry and the drawings, from a bag, by an independent reader.

A robot with its fans stands up, trots round a bend with their help, and loses its drives; what the
bag holds is read with rosbags and compared with MuJoCo's kinematics of the measured joints.
"""

from collections import defaultdict
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation
from seen_robot import SETTINGS, Robot, running

from husky_description.mujoco_model import build_spec
from husky_description.robot import load_robot
from husky_description.urdf import build_urdf
from husky_runtime import graph

pytestmark = pytest.mark.graph

ROBOT = load_robot()
SHARE = 0.3
"""Of the weight, on the fans."""
TOPICS = (
    graph.TF,
    graph.TF_STATIC,
    graph.ODOM,
    graph.ODOMETRY,
    graph.JOINT_STATES,
    graph.GROUND_TRUTH,
    graph.T265_ODOMETRY,
    graph.ESTIMATE_ERROR,
    graph.CONTROLLER_STATE,
    graph.FAN_STATE,
    graph.MARKERS,
    graph.ROBOT_DESCRIPTION,
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of four seconds: the bag, and who subscribes to what."""
    directory = tmp_path_factory.mktemp("frames")
    settings = {name: dict(values) for name, values in SETTINGS.items()}
    settings[graph.PLANT]["body"] = "robot_with_unit"
    with running(directory, settings, record=True) as session:
        robot = Robot(session)
        robot.stand()
        session.set_flight_mode("OFFBOARD")
        session.arm()
        session.set_parameter(graph.LOW_LEVEL_CONTROLLER, "assist.share", SHARE)
        robot.trot()
        session.set_velocity(0.3, 0.05, 0.5)
        session.advance(1.0)
        readers = {
            info.node_name
            for topic in (graph.TF, graph.TF_STATIC, graph.GROUND_TRUTH)
            for info in robot._ear.get_subscriptions_info_by_topic(topic)
        }
        robot.trigger(graph.DRIVES_EMERGENCY_STOP)
        session.advance(0.3)
        robot.close()
    return directory / "bag", readers


@pytest.fixture(scope="module")
def heard(run):
    """Messages by topic, in the bag's order."""
    messages, names = defaultdict(list), {graph.absolute(name): name for name in TOPICS}
    with AnyReader([run[0]]) as reader:
        wanted = [c for c in reader.connections if c.topic in names]
        for connection, _, data in reader.messages(wanted):
            messages[names[connection.topic]].append(reader.deserialize(data, connection.msgtype))
    return messages


def stamp(message):
    """Stamp of a message or its header [ns]."""
    time = getattr(message, "header", message).stamp
    return time.sec * 1_000_000_000 + time.nanosec


def matrix(place, turn):
    """A pose as a homogeneous matrix (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)).as_matrix()
    result[:3, 3] = place.x, place.y, place.z
    return result


def pose_of(odometry):
    return matrix(odometry.pose.pose.position, odometry.pose.pose.orientation)


@pytest.fixture(scope="module")
def tree(heard):
    """Transforms by child: its parent, and poses (4, 4) by stamp; fixed ones under None."""
    parents, poses = {}, defaultdict(dict)
    for topic in (graph.TF_STATIC, graph.TF):
        for message in heard[topic]:
            for each in message.transforms:
                parent, child = each.header.frame_id, each.child_frame_id
                assert parents.setdefault(child, parent) == parent, f"{child} has two parents"
                when = None if topic == graph.TF_STATIC else stamp(each)
                t = each.transform
                poses[child][when] = matrix(t.translation, t.rotation)
    return parents, poses


def links_of(urdf):
    """Names of the links, in the URDF's order."""
    return [link.get("name") for link in ElementTree.fromstring(urdf).findall("link")]


def ancestors(parents, frame):
    """A frame and those above it, up to the root."""
    chain = [frame]
    while chain[-1] in parents:
        chain.append(parents[chain[-1]])
        assert len(chain) < 20, f"a circle: {chain}"
    return chain


def looked_up(tree, target, frame, when):
    """Pose of a frame in one above it, of this very time or fixed."""
    parents, poses = tree
    pose = np.eye(4)
    chain = ancestors(parents, frame)
    for child in chain[: chain.index(target)]:
        known = poses[child]
        pose = (known[None] if None in known else known[when]) @ pose
    return pose


def test_one_tree_holds_every_link_and_world_and_the_cameras_world(tree, heard):
    """As a 3-D panel needs it: every link of the told URDF has a path to odom."""
    (description,) = heard[graph.ROBOT_DESCRIPTION]
    assert description.data == build_urdf(ROBOT)
    links = links_of(description.data)
    assert links[0] == "base_link"
    for frame in (*links, "base_footprint", "world", "t265_odom"):
        assert ancestors(tree[0], frame)[-1] == "odom", frame
    assert tree[0]["base_link"] == "odom"


def test_links_are_where_mujoco_has_them(tree, heard):
    """By the joint states of the same stamp, to a micrometre; 50 times a second."""
    model = build_spec(ROBOT).compile()
    data = mujoco.MjData(model)
    joints = {stamp(m): m for m in heard[graph.JOINT_STATES]}
    times = sorted(tree[1]["front_left_hip"])
    assert np.all(np.diff(times) == 20_000_000)
    for when in times[::10]:
        state = joints[when]
        order = [state.name.index(name) for name in ROBOT.joint_names]
        data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *state.position[order]]
        mujoco.mj_forward(model, data)
        for leg in ROBOT.legs:
            for link in ("hip", "thigh", "shin"):
                pose = looked_up(tree, "base_link", f"{leg}_{link}", when)
                body = data.body(f"{leg}_{link}")
                np.testing.assert_allclose(pose[:3, 3], body.xpos, atol=1e-6)
                np.testing.assert_allclose(pose[:3, :3], body.xmat.reshape(3, 3), atol=1e-6)
            for frame in (f"{leg}_foot", f"{leg}_fan"):
                pose = looked_up(tree, "base_link", frame, when)
                np.testing.assert_allclose(pose[:3, 3], data.site(frame).xpos, atol=1e-6)
        for frame in ("imu_link", "t265_link", "perch"):
            pose = looked_up(tree, "base_link", frame, when)
            site = data.site(frame.removesuffix("_link"))
            np.testing.assert_allclose(pose[:3, 3], site.xpos, atol=1e-6)


def test_the_base_is_in_odom_where_odometry_has_it(tree, heard):
    assert len(heard[graph.ODOM]) > 150
    for message in heard[graph.ODOM]:
        assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
        pose = tree[1]["base_link"][stamp(message)]
        np.testing.assert_allclose(pose, pose_of(message), atol=1e-12)
    # Under its earlier name it is the same, bit for bit.
    same = zip(heard[graph.ODOM], heard[graph.ODOMETRY], strict=True)
    assert all(repr(one) == repr(other) for one, other in same)


def test_the_footfootprintis_level_amid_the_feet(tree, heard):
    """REP-120: level with odom, heading of the base, at the lowest sole."""
    when = max(set(tree[1]["base_footprint"]) & set(tree[1]["base_link"]))
    footprint = looked_up(tree, "odom", "base_footprint", when)
    base = looked_up(tree, "odom", "base_link", when)
    np.testing.assert_allclose(footprint[:3, 2], (0.0, 0.0, 1.0), atol=1e-9)
    heading = np.arctan2(base[1, 0], base[0, 0])
    assert np.arctan2(footprint[1, 0], footprint[0, 0]) == pytest.approx(heading, abs=1e-9)
    # Joints are told 2 ms after it.
    feet = np.array(
        [base @ looked_up(tree, "base_link", f"{leg}_foot", when + 2_000_000) for leg in ROBOT.legs]
    )[:, :3, 3]
    lowest = feet[:, 2].min() - ROBOT.foot_radius
    np.testing.assert_allclose(footprint[:3, 3], (*feet[:, :2].mean(axis=0), lowest), atol=0.01)


def test_the_truth_and_the_camera_are_seen_in_the_tree(tree, heard):
    """At the stamps of the tree a look-up gives what the topics say, exactly."""
    for topic, frame, link in (
        (graph.GROUND_TRUTH, "world", "base_link"),
        (graph.T265_ODOMETRY, "t265_odom", "t265_link"),
    ):
        told = {stamp(m): pose_of(m) for m in heard[topic]}
        transforms = tree[1][frame]
        assert tree[0][frame] == link and len(transforms) > 150
        for when, pose in transforms.items():
            np.testing.assert_allclose(np.linalg.inv(pose), told[when], atol=1e-9)


def test_the_truth_reaches_none_of_the_robots_nodes(run):
    assert not run[1] & (set(graph.NODES) - {graph.PLANT}), run[1]


def test_odometry_says_how_well_it_is_known(heard):
    """Covariances of pose and twist, symmetric and positive definite, and as honest as measured."""
    errors = {stamp(m): m for m in heard[graph.ESTIMATE_ERROR]}
    normalised = []
    for message in heard[graph.ODOM]:
        pose = message.pose.covariance.reshape(6, 6)
        twist = message.twist.covariance.reshape(6, 6)
        for each in (pose, twist):
            np.testing.assert_array_equal(each, each.T)
            assert np.linalg.eigvalsh(each).min() > 0.0
        error = errors.get(stamp(message))
        if error is None:
            continue
        turn = pose_of(message)[:3, :3]
        velocity_in_world = turn @ twist[:3, :3] @ turn.T
        normalised.append(
            np.concatenate(
                (
                    error.position / np.sqrt(np.diag(pose)[:3]),
                    error.velocity / np.sqrt(np.diag(velocity_in_world)),
                    (turn @ error.attitude) / np.sqrt(np.diag(pose)[3:]),
                )
            )
        )
    table = np.array(normalised)
    assert len(table) > 150
    assert np.mean(np.abs(table) < 3.0) > 0.97, np.abs(table).max(axis=0)
    assert np.sqrt(np.mean(table**2)) > 0.1, "far too careful"


def test_what_the_imu_and_the_camera_tell_is_no_less(heard):
    for message in (*heard[graph.T265_ODOMETRY][::50], heard[graph.GROUND_TRUTH][-1]):
        for part in (message.pose, message.twist):
            assert np.linalg.eigvalsh(part.covariance.reshape(6, 6)).min() > 0.0


def test_odometry_goes_on_when_the_drives_are_lost(heard):
    """REP-105: no jumps in odom, though the filter ends with the drives."""
    modes = {stamp(m): m.mode for m in heard[graph.CONTROLLER_STATE]}
    places = np.array([pose_of(m)[:2, 3] for m in heard[graph.ODOM]])
    lost = [modes[stamp(m)] in ("settle", "damping") for m in heard[graph.ODOM]]
    assert 5 < sum(lost) < len(lost)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert np.linalg.norm(places[-1]) > 0.3 and steps.max() < 0.03, steps.max()


def test_drawings_are_where_things_are(heard):
    """Ten times a second; arrows of the ground's forces and of the thrust are as long as these."""
    drawn = defaultdict(list)
    for message in heard[graph.MARKERS]:
        for marker in message.markers:
            drawn[marker.ns, marker.id].append(marker)
    assert {name for name, _ in drawn} == {"foot_force", "foothold", "way", "fan_thrust", "thrust"}
    for markers in drawn.values():
        steps = np.diff([stamp(m) for m in markers])
        assert steps.min() >= 95_000_000, "throttled to 10 Hz"
    states = heard[graph.FAN_STATE]
    total = {stamp(m): m.thrust.sum() for m in states}
    arrows = [m for m in drawn["thrust", 0] if m.color.a == 1.0]
    last = max(arrows, key=lambda m: ends(m)[1][2] - ends(m)[0][2])
    length = np.linalg.norm(np.subtract(*ends(last))) / 0.008
    when = min(total, key=lambda t: abs(t - stamp(last)))
    assert length == pytest.approx(total[when], rel=0.1) and length > 10.0
    assert last.header.frame_id == "base_link"
    standing = [m for leg in range(4) for m in drawn["foot_force", leg] if m.color.a == 1.0]
    odom = {stamp(m): pose_of(m) for m in heard[graph.ODOM]}
    for marker in standing:
        (start, tip), base = ends(marker), odom[stamp(marker)]
        assert marker.header.frame_id == "odom" and tip[2] > start[2]
        reach = np.linalg.norm(np.subtract(start, base[:3, 3]))
        assert 0.1 < reach < 0.75, "an arrow begins at a foot"


def ends(marker):
    return [(p.x, p.y, p.z) for p in marker.points]

"""Fans, battery and camera that fail while the robot trots with their help."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from husky_bringup.system import NodeSpec
from husky_description.rotation import conjugate, rotate
from husky_runtime import graph
from husky_runtime.nodes import stamps
from husky_runtime.nodes.diagnostics import PERIOD

pytestmark = pytest.mark.graph

SETTLED = 0.3
"""The voltage falls at once, and with it the thrust, which the autopilot then makes up for [s]."""
WATCHED = 0.6
"""The localizer gives the T265 up when it has been silent for 0.5 s. It watches one that has jumped
or was gone for as long, then uses a pose of it every 0.05 s [s]."""
ODOMETRY_PERIOD = 20_000_000
"""[ns]"""
ERROR = 0.01
"""Of the base's motion in map and odom, over 0.4 m at most [m]: legs and T265 drift by 2 % of it at
most, and the base in map takes a share of the camera's noise. A jump is of 0.3 m."""
STEP = 0.004
"""Of `odom` in map with a message [m]: three times what noise has been seen to make."""


def test_fan_lost_while_trotting(assisted, record_property):
    """The autopilot finds it, tells it, and gives its share to the others: no moment is left."""
    s = assisted.session
    failed = assisted.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "front_left_fan", "fail")
    s.advance(1.6)
    times, thrusts = assisted.thrusts()
    record_property("reaction_s", times[thrusts[:, 0] > 0.2][-1] - failed)
    record_property("rise_n", assisted.rise(failed))
    record_property("others_n", (thrusts[0, 1:].sum(), thrusts[-1, 1:].sum()))
    record_property("others_max_n", thrusts[:, 1:].sum(axis=1).max())
    record_property("heights_m", assisted.trots_on())
    assert thrusts[-1, 0] < 0.05, assisted.seen
    assert list(s.propulsion.fan_ok) == [False, True, True, True], assisted.seen
    assert s.propulsion.reason == "Fan front_left lost" and s.propulsion.thrust_limit < 50.0
    assisted.robot.reported(graph.PIXHAWK_BRIDGE, "fan lost: front_left")
    # The share that was asked for, within what moments of the controller take from it.
    assert abs(thrusts[-1].sum() - thrusts[0].sum()) < 0.1 * thrusts[0].sum(), assisted.seen
    assert s.propulsion.armed and not s.propulsion.failsafe, assisted.seen
    assisted.recover()


# In one process: `test_critical_battery`, `test_every_check_by_itself` (arming is refused). Without
# its fans the robot trots on: `test_flight_controller_killed`.
@pytest.mark.slow
@pytest.mark.parametrize("charge", ["0.0", "0.05"])
def test_battery_empty(assisted, record_property, charge):
    s = assisted.session
    failed = assisted.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "battery", charge)
    record_property("reaction_s", assisted.thrust_ends(failed, SETTLED))
    record_property("heights_m", assisted.trots_on())
    assert not s.propulsion.armed, assisted.seen
    assert "attery" in s.propulsion.reason or "isarmed" in s.propulsion.reason, assisted.seen
    answer = assisted.arming_refused()
    assert "battery" in answer, answer
    assisted.recover()


class Localizer:
    """The node `localizer` beside a graph, and where it has the base."""

    def __init__(self, robot):
        """Start it; the world stands still until it reports."""
        self.robot, self.session = robot, robot.session
        self._poses = robot.tap(PoseWithCovarianceStamped, graph.MAP_POSE, reliable=True)
        self._odometry = robot.tap(Odometry, graph.ODOMETRY, reliable=True)
        self._truths = robot.tap(Odometry, graph.GROUND_TRUTH, reliable=True)
        self._transforms = robot.tap(TFMessage, graph.TF, reliable=True)
        spec = NodeSpec("husky_navigation", graph.LOCALIZER, {PERIOD: 0.2})
        self.session.processes.start(spec)
        robot.reported(graph.LOCALIZER, "waiting for odometry")

    def end(self):
        """End it; return its exit code."""
        return self.session.processes.end(graph.LOCALIZER)[graph.LOCALIZER]

    def counters(self, state, level=DiagnosticStatus.OK):
        """Return the counters of its report of a state and level, once it has all odometry."""
        self.session.wait_for(self._has_caught_up, "the newest pose in map")
        report = self.robot.reported(graph.LOCALIZER, state)
        assert report.level == level, self.robot.seen
        return {entry.key: int(entry.value) for entry in report.values if entry.value.isdecimal()}

    def _has_caught_up(self):
        poses = self._poses.drain()
        now = round(1e9 * self.session.time)
        return bool(poses) and stamps.to_ns(poses[-1].header.stamp) > now - ODOMETRY_PERIOD

    def is_fused(self):
        """Return whether the T265 is used."""
        return self.robot.reported(graph.LOCALIZER, "").message == "fused"

    def watch(self):
        """Look at the base from now on."""
        for tap in (self._poses, self._odometry, self._truths, self._transforms):
            tap.clear()

    def has_followed(self, record_property):
        """Assert that the base was followed in map and odom since `watch`, without a step."""
        self.session.wait_for(self._has_caught_up, "the newest pose in map")
        tracks = [
            Track([(stamps.to_ns(m.header.stamp), m.pose.pose) for m in tap.drain()])
            for tap in (self._truths, self._odometry, self._poses)
        ]
        begin = max(track.times[0] for track in tracks)
        end = min(track.times[-1] for track in tracks)
        in_world, in_odom, in_map = tracks
        times = in_map.times[(begin <= in_map.times) & (in_map.times <= end)]
        true = in_world.seen_at(times)
        errors = [max(lengths(track.seen_at(times) - true)) for track in (in_map, in_odom)]
        edges = [edge for message in self._transforms.drain() for edge in message.transforms]
        origins = [
            xyz(edge.transform.translation)
            for edge in edges
            if (edge.header.frame_id, edge.child_frame_id) == (graph.FRAME_MAP, graph.FRAME_ODOM)
        ]
        assert len(times) > 20 and len(origins) > 20, "the taps heard too little"
        step, distance = max(lengths(np.diff(origins, axis=0))), max(lengths(true))
        record_property("distance_errors_step_m", (distance, *errors, step))
        assert distance > 0.1, "it has not walked"
        assert max(errors) < ERROR, f"in map and odom {errors} m wrong"
        assert step < STEP, f"odom steps by {step} m in map"


class Track:
    """Poses of the base in a frame."""

    def __init__(self, poses):
        """Take times [ns] and poses."""
        self.times = np.array([time for time, _ in poses])
        self._positions = np.array([xyz(pose.position) for _, pose in poses])
        self._orientations = [pose.orientation for _, pose in poses]

    def seen_at(self, times):
        """Return where the base is at times, as seen from where it is at the first [m] (n, 3)."""
        columns = [np.interp(times, self.times, column) for column in self._positions.T]
        positions = np.stack(columns, axis=1)
        q = self._orientations[int(np.argmin(np.abs(self.times - times[0])))]
        back = conjugate((q.x, q.y, q.z, q.w))
        return np.array([rotate(back, step) for step in (positions - positions[0]).tolist()])


def xyz(vector):
    """Return a vector of a message as plain numbers."""
    return vector.x, vector.y, vector.z


def lengths(vectors):
    """Return the length of each of some vectors (n, 3)."""
    return np.linalg.norm(vectors, axis=1).tolist()


@pytest.fixture(scope="module")
def started_localizer(fans_of_module):
    """A localizer beside the graph, for the tests of the T265; it ends as it should."""
    localizer = Localizer(fans_of_module.robot)
    yield localizer
    assert localizer.end() == 0


@pytest.fixture
def localizer(started_localizer, assisted):
    """A localizer that uses the T265 of a trotting robot."""
    assisted.robot.until(
        started_localizer.is_fused, "a localizer that uses the T265", within=2.0, step=0.2
    )
    return started_localizer


def test_t265_freezes(assisted, localizer, record_property):
    """No foot and no fan follows the camera; the base in map goes on by the legs."""
    s = assisted.session
    before = localizer.counters("fused")
    localizer.watch()
    failed = assisted.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "t265", "freeze")
    s.advance(WATCHED)
    assisted.trots_on()
    assert assisted.helps(failed), assisted.seen
    frozen = localizer.counters("tracking frozen", DiagnosticStatus.WARN)
    assert frozen["frozen"] - before["frozen"] == 1, assisted.seen
    # Poses that are ahead of odometry wait for it.
    assert frozen["tracking"] - before["tracking"] <= 4, "poses of a frozen camera"
    s.inject(graph.PLANT_INJECT_FAULT, "t265", "")
    s.advance(WATCHED)
    healed = localizer.counters("fused")
    assert healed["tracking"] > frozen["tracking"] and healed["jumps"] == before["jumps"]
    localizer.has_followed(record_property)


def test_t265_jumps(assisted, localizer, record_property):
    """Its driver and the localizer tell; the base stays in map where it was."""
    s, robot = assisted.session, assisted.robot
    told, before = robot.told(graph.T265_DRIVER, "jumps"), localizer.counters("fused")
    localizer.watch()
    failed = assisted.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "t265", "jump")
    s.advance(WATCHED)
    assert robot.told(graph.T265_DRIVER, "jumps") - told == 1
    assisted.trots_on()
    assert assisted.helps(failed), assisted.seen
    after = localizer.counters("fused")
    changes = [after[kind] - before[kind] for kind in ("jumps", "absorbed", "relocalised")]
    assert changes == [1, 1, 0], assisted.seen
    localizer.has_followed(record_property)

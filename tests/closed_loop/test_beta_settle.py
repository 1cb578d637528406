"""Husky-beta lets go of its legs in one process: whatever they do, its body is lowered first."""

import numpy as np
import pytest
from flying_beta import FlyingBeta

pytestmark = pytest.mark.in_a_copy  # each goes on from the same robot

AHEAD, TURN, SIDE = (0.3, 0.0, 0.0), (0.0, 0.0, 0.5), (0.0, 0.1, 0.0)
PHASES = (0.06, 0.19, 0.31, 0.44)
"""Times in the trot, whose cycle is 0.5 s."""
SLOW = pytest.mark.slow
"""Further phases and joints: one of each kind is not slow."""


class Settler(FlyingBeta):
    """Notes how it comes down.

    Attributes:
        late: age of every IMU sample [s].
    """

    late = 0.0

    def _feel(self):
        super()._feel()
        self.measurements.imu_age = self.late

    def come_down(self, most=2.0):
        """Return greatest tilt [deg] and the speed at which the perch meets the ground [m/s]."""
        tilt, sink, above = 0.0, 0.0, self.above_perch
        for _ in range(round(most / 0.01)):
            speed = -self.data.qvel[2]
            self.run(0.01)
            tilt = max(tilt, self.tilt)
            if self.above_perch < 0.003 <= above:
                sink = max(sink, speed)
            above = self.above_perch
        return tilt, sink


@pytest.fixture(scope="module")
def standing():
    robot = Settler(1)
    robot.stand()
    return robot


def trot(robot, velocity, phase):
    assert robot.controller.request_mode("walk")[0]
    robot.run(1.0 + phase, velocity)


@pytest.mark.parametrize(
    ("velocity", "phase", "stop"),
    [
        (AHEAD, PHASES[0], "damping"),
        *(pytest.param(AHEAD, phase, "damping", marks=SLOW) for phase in PHASES[1:]),
        (TURN, 0.2, "damping"),
        pytest.param(AHEAD, 0.19, "emergency_stop", marks=SLOW),
        (SIDE, 0.3, "emergency_stop"),
    ],
)
def test_in_the_trot_a_stop_sets_it_down_level(standing, velocity, phase, stop):
    """Damped it would sink for seconds, over two feet, and fall on its side."""
    robot = standing
    trot(robot, velocity, phase)
    assert robot.controller.request_mode(stop) == (True, "settle")
    tilt, sink = robot.come_down()
    assert robot.controller.mode.value == stop
    assert tilt < 9.0 and sink < 1.0
    assert robot.tilt < 4.0 and robot.above_perch < 0.01
    assert np.abs(robot.data.qvel[:6]).max() < 0.02


def test_while_it_settles_the_last_stop_that_is_asked_for_counts(standing):
    robot = standing
    assert robot.controller.request_mode("damping")[0]
    robot.run(0.1)
    accepted, message = robot.controller.request_mode("emergency_stop")
    assert accepted and message == "settling; emergency_stop when the body is down"
    accepted, message = robot.controller.request_mode("stand")
    assert not accepted and "cannot follow settle" in message
    robot.run(0.8)
    assert robot.controller.mode.value == "emergency_stop"


@pytest.mark.parametrize(
    ("joint", "phase"),
    [
        ("front_left_hip_frontal", 0.06),
        ("front_right_knee", 0.31),
        pytest.param("front_left_hip_frontal", 0.31, marks=SLOW),
        pytest.param("front_right_knee", 0.06, marks=SLOW),
        pytest.param("hind_right_knee", 0.06, marks=SLOW),
        pytest.param("hind_right_knee", 0.31, marks=SLOW),
    ],
)
def test_with_a_servo_that_has_let_go_it_does_not_fall_on_its_side(standing, joint, phase):
    robot = standing
    trot(robot, AHEAD, phase)
    robot.lose_servo(joint)
    tilt, sink = robot.come_down()
    assert robot.controller.mode.value == "damping"
    assert robot.controller.counters.faults == 1
    assert tilt < 40.0 and robot.tilt < 40.0 and sink < 1.2


@pytest.mark.parametrize("wait", [0.9, 1.8, 3.6])
def test_on_its_way_to_the_perch_it_goes_no_further_up(standing, wait):
    """Before and after the perch has touched; folded legs stay as they are."""
    robot = standing
    assert robot.controller.request_mode("perch")[0]
    robot.run(wait)
    folded = wait > 3.0
    knees = robot.data.qpos[9::3].copy()
    assert robot.controller.request_mode("damping") == (True, "settle")
    tilt, sink = robot.come_down(1.0)
    assert tilt < 3.0 and sink < 1.0 and robot.above_perch < 0.003
    assert robot.controller.mode.value == "damping"
    if folded:
        assert np.abs(robot.data.qpos[9::3] - knees).max() < 0.1


@pytest.fixture(scope="module")
def balancing(standing):
    """Stands on three legs, the front left one is an arm: what `standing` has become by now."""
    robot = standing
    robot.gear.arm()
    robot.run(0.3)
    robot.become("balance")
    return robot


# Joints 0, 4 and 8, one of each kind and each of another leg, are not slow.
@pytest.mark.parametrize("joint", [pytest.param(i, marks=[SLOW] * (i % 4 != 0)) for i in range(12)])
def test_with_one_leg_an_arm_any_servo_may_let_go(balancing, joint):
    """Legs and body go down at once; without that it fell, up to onto its back."""
    robot = balancing
    robot.lose_servo(robot.robot.joint_names[joint])
    tilt, sink = robot.come_down()
    assert robot.controller.mode.value == "damping"
    assert tilt < 18.0 and sink < 1.3
    assert robot.tilt < 4.0 and robot.above_perch < 0.01
    assert robot.propellers.unit.thrust.max() < 0.1


@pytest.mark.parametrize("why", ["damping requested", "an IMU that is silent"])
def test_with_one_leg_an_arm_it_is_put_down_level(balancing, why):
    robot = balancing
    if why == "damping requested":
        accepted, message = robot.controller.request_mode("damping")
        assert accepted and message == "it puts its legs and its body down; damping follows"
        assert robot.controller.request_mode("stand") == (False, "it puts its legs down")
    else:
        robot.late = 0.3
    tilt, sink = robot.come_down(4.0)
    assert robot.controller.mode.value == "damping"
    assert tilt < 9.0 and sink < 1.0 and robot.tilt < 4.0

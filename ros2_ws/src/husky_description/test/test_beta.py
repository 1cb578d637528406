"""Husky-beta: masses that add up, propellers of the maker's table, postures that it can take."""

import copy
import math

import mujoco
import numpy as np
import pytest
import yaml
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from husky_description.actuation import OWN_SECTIONS, AbsentSection
from husky_description.bus_servo import MODEL_NUMBERS
from husky_description.fan import FanModel
from husky_description.gravity import GRAVITY
from husky_description.mujoco_model import build_spec
from husky_description.parameters import Bounds, bounds_of
from husky_description.robot import load_robot, make_robot
from husky_description.share import share_path

ROBOT = load_robot("beta")
TREE = yaml.safe_load(share_path("config/beta.yaml").read_text())
POUND, INCH_POUND, RPM = 4.4482216, 0.11298483, math.pi / 30

PARTS_OF_BODY = {
    "four hip frontal servos": 4 * 0.165,
    "computer": 0.155,
    "flight controller and power module": 0.060,
    "servo controller and converters": 0.070,
    "four speed controllers": 0.120,
    "T265": 0.055,
    "VN-200": 0.016,
    "two vertical plates": 0.150,
    "frame and brackets": 0.330,
    "perch": 0.120,
    "wiring": 0.110,
    "fasteners": 0.036,
}
"""The table of docs/beta.md [kg]."""

FLIGHT_KNEE = ROBOT.propellers.flight_knee


@pytest.fixture(scope="module")
def model():
    spec = build_spec(ROBOT)
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[10, 10, 0.1])
    return spec.compile()


@pytest.fixture
def data(model):
    return mujoco.MjData(model)


def touching(model, data):
    return {
        frozenset((model.geom(c.geom1).name, model.geom(c.geom2).name))
        for c in data.contact[: data.ncon]
        if c.dist < 0.0
    }


def put(model, data, key, frontal, sagittal, knee):
    """The robot as in a keyframe, but its legs splayed outward and swept alike [rad]."""
    mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
    for leg in range(4):
        data.qpos[7 + 3 * leg : 10 + 3 * leg] = ROBOT.side[leg] * frontal, sagittal, knee
    mujoco.mj_forward(model, data)


def lift_from_mass(model, data, sagittal):
    """Centre of lift from the centre of mass when splayed [m] (3,)."""
    put(model, data, "sit", math.pi / 2, sagittal, FLIGHT_KNEE)
    lift = np.mean([data.site(f"{leg}_propeller").xpos for leg in ROBOT.legs], axis=0)
    return lift - data.subtree_com[model.body("base").id]


def test_masses_add_up():
    assert sum(PARTS_OF_BODY.values()) == pytest.approx(ROBOT.base_mass, abs=1e-9)
    assert ROBOT.payload_mass == pytest.approx(0.240, abs=1e-9)  # battery [T17], with the camera
    leg = ROBOT.hip_mass + ROBOT.thigh_mass + ROBOT.shin_mass + ROBOT.knee_mass
    assert ROBOT.base_mass + ROBOT.payload_mass + 4 * leg == pytest.approx(ROBOT.mass, abs=1e-9)


def test_propellers_are_those_of_the_maker_s_table():
    """Points of APC's static predictions of the 12x4.5MR; three digits leave 1 % at 4000 rpm."""
    for rpm, pounds, inch_pounds in (
        (4000, 0.952, 0.623),
        (5000, 1.492, 0.957),
        (7000, 2.946, 1.842),
        (8000, 3.865, 2.396),
        (9000, 4.918, 3.029),
        (11000, 7.443, 4.545),
    ):
        thrust = ROBOT.propellers.static_thrust(rpm * RPM)
        torque = ROBOT.propellers.static_torque(rpm * RPM)
        assert thrust == pytest.approx(pounds * POUND, rel=0.01)
        assert torque == pytest.approx(inch_pounds * INCH_POUND, rel=0.01)
    assert ROBOT.propellers.static_thrust(0.0) == 0.0


def test_full_speed_is_what_motor_and_battery_give():
    """The motor's equation on the nominal pack with all four at full throttle."""
    p, battery = ROBOT.propellers, ROBOT.battery
    resistance = battery.cells * battery.cell_resistance + battery.wiring_resistance

    def surplus(speed):
        current = p.static_torque(speed) * p.speed_constant + p.no_load_current
        load = 4 * current + battery.idle_power / 14.8
        return 14.8 - load * resistance - current * p.resistance - speed / p.speed_constant

    assert p.full_speed == pytest.approx(brentq(surplus, 300.0, 1150.0), rel=0.002)
    assert 1.6 <= 4 * FanModel.of(ROBOT).max_thrust / (ROBOT.mass * GRAVITY) <= 2.0


def test_servo_is_one_that_exists_and_its_gains_are_the_law_s():
    servo, law = ROBOT.bus_servo, ROBOT.servo
    assert MODEL_NUMBERS[servo.model] == servo.model_number
    assert law.torque_limit == servo.torque_limit < servo.stall_torque
    assert ROBOT.joint_velocity_limit[0] < servo.no_load_speed
    radian, full = servo.resolution / (2 * math.pi), 885.0  # counts; steps of PWM
    kp = servo.position_p / 128 * radian / full * servo.stall_torque
    kd = servo.position_d / 16 * radian / 1000 / full * servo.stall_torque
    assert kp == pytest.approx(law.kp, rel=0.01)
    assert kd + servo.stall_torque / servo.no_load_speed == pytest.approx(law.kd, rel=0.01)


def test_sections_of_the_other_robot_are_absent_by_name():
    carbon = load_robot()
    for name in OWN_SECTIONS["drives"]:
        with pytest.raises(AbsentSection, match=f"husky_beta has no section '{name}'.*bus_servo"):
            getattr(ROBOT, name)
    for name in OWN_SECTIONS["bus_servos"]:
        with pytest.raises(AbsentSection, match=f"husky_carbon has no section '{name}'.*motor"):
            getattr(carbon, name)


def test_thrust_points_up_when_splayed_and_outward_when_standing(model, data):
    put(model, data, "sit", math.pi / 2, 0.3, FLIGHT_KNEE)
    for leg in ROBOT.legs:
        axis = data.site(f"{leg}_propeller").xmat.reshape(3, 3)[:, 2]
        np.testing.assert_allclose(axis, [0.0, 0.0, 1.0], atol=1e-12)
    put(model, data, "stand", 0.0, 0.6, -1.3)
    for leg, side in zip(ROBOT.legs, ROBOT.side, strict=True):
        axis = data.site(f"{leg}_propeller").xmat.reshape(3, 3)[:, 2]
        np.testing.assert_allclose(axis, [0.0, side, 0.0], atol=1e-12)


def test_a_sweep_puts_the_lift_over_the_centre_of_mass(model, data):
    """Femur and tibia parallel to the floor; nothing touches, the discs stay apart."""
    sweep = brentq(lambda angle: lift_from_mass(model, data, angle)[0], -1.0, 1.0)
    offset = lift_from_mass(model, data, sweep)
    assert np.abs(offset[:2]).max() < 1e-6 and offset[2] > 0.0
    assert ROBOT.joint_lower[1] + 0.5 < sweep < ROBOT.joint_upper[1] - 0.5
    for leg in ROBOT.legs:
        for link in ("thigh", "shin"):
            assert abs(data.body(f"{leg}_{link}").xmat[8]) < 1e-9  # its length is level
    # The splayed robot rests on its perch, half a millimetre above the floor as in the keyframe.
    assert touching(model, data) == set()
    places = np.array([data.site(f"{leg}_propeller").xpos for leg in ROBOT.legs])
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(4, 1)]
    assert apart.min() > 1.25 * ROBOT.propellers.diameter


def test_nothing_touches_on_the_way_from_sitting_to_flight(model, data):
    """Fold the legs, splay, sweep: beyond the feet on the ground there is no contact."""
    _, sagittal, knee = ROBOT.sit_joint_position[:3]
    fold, leg = 0.68, ROBOT.leg  # so far that the discs of left and right stay apart
    feet = {frozenset(("floor", name)) for name in ROBOT.foot_names}
    ways = [
        ((0.0, sagittal, knee), (0.0, fold, -2.6)),
        ((0.0, fold, -2.6), (math.pi / 2, fold, -2.6)),
        ((math.pi / 2, fold, -2.6), (math.pi / 2, -0.1, FLIGHT_KNEE)),
    ]
    for start, end in ways:
        for share in np.linspace(0.0, 1.0, 41):
            put(model, data, "sit", *(np.array(start) + share * (np.array(end) - start)))
            assert touching(model, data) <= feet
            assert np.all(data.qpos[7:] >= ROBOT.joint_lower)
            assert np.all(data.qpos[7:] <= ROBOT.joint_upper)
            # The parallelogram's own ends, which the serial equivalent has elsewhere.
            thigh, shin = (data.body(f"front_left_{link}") for link in ("thigh", "shin"))
            pin = thigh.xpos - leg.thigh_link * thigh.xmat.reshape(3, 3)[:, 2]
            ankle = pin - leg.calf_link * shin.xmat.reshape(3, 3)[:, 2]
            assert min(pin[2], ankle[2]) > 2 * leg.tube_outer_radius


def test_standing_and_sitting_keep_propellers_off_the_ground(model, data):
    for key, perch in (("stand", 0.05), ("sit", 0.0)):
        mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
        mujoco.mj_forward(model, data)
        for leg in ROBOT.legs:
            height = data.site(f"{leg}_propeller").xpos[2] - ROBOT.propellers.diameter / 2
            assert height > 0.015
            assert data.body(f"{leg}_shin").xpos[2] > 0.05
        assert data.site("perch").xpos[2] > perch
        assert all("floor" in pair for pair in touching(model, data))


def test_it_rests_on_the_perch_with_its_legs_splayed(model, data):
    """Held by the servos' law at their limit, it comes to rest level, on the perch alone."""
    target = np.ravel([[side * math.pi / 2, -0.1, FLIGHT_KNEE] for side in ROBOT.side])
    put(model, data, "sit", math.pi / 2, -0.1, FLIGHT_KNEE)
    law = ROBOT.servo
    peak = np.zeros(12)
    for _ in range(2000):
        torque = law.kp * (target - data.qpos[7:]) - law.kd * data.qvel[6:]
        data.ctrl[:] = np.clip(torque, -law.torque_limit, law.torque_limit)
        peak = np.maximum(peak, np.abs(data.ctrl))
        mujoco.mj_step(model, data)
    assert touching(model, data) <= {frozenset(("floor", "perch"))}
    assert np.abs(data.qvel).max() < 0.01
    x, y, z, w = np.roll(data.qpos[3:7], -1)
    assert Rotation.from_quat([x, y, z, w]).magnitude() < math.radians(3.0)
    # Shin and foot, 0.22 m out, are most of what each hip frontal servo holds.
    assert 0.5 < peak.max() < 2.0


def test_hover_asks_less_of_the_hips_than_the_servos_give():
    """Thrust at the knees lifts the body through the hips; static, legs' own weight left out."""
    arm = ROBOT.leg.thigh_link
    assert FanModel.of(ROBOT).max_thrust * arm < ROBOT.bus_servo.torque_limit


def test_numbers_that_contradict_each_other():
    for key, value, message in (
        ("spin", [1.0, 1.0, -1.0, -1.0], r"propellers\.spin: .*neighbours"),
        ("full_speed", 2000.0, r"propellers\.full_speed: 2000 is above"),
        ("thrust", [1.0] * 9, r"propellers\.thrust: does not rise"),
    ):
        tree = copy.deepcopy(TREE)
        tree["propellers"][key] = value
        with pytest.raises(ValueError, match=message):
            make_robot(tree)


@pytest.mark.parametrize("section", OWN_SECTIONS["bus_servos"])
def test_every_number_of_its_own_sections_is_checked(section):
    for key, bounds in bounds_of(OWN_SECTIONS["bus_servos"][section]).items():
        if not isinstance(bounds, Bounds):
            continue
        for wrong in (math.nan, bounds.lower - 1.0, bounds.upper + 1.0, "1.0", None):
            tree = copy.deepcopy(TREE)
            tree[section][key] = [wrong] * bounds.size if bounds.size else wrong
            with pytest.raises(ValueError, match=rf"^{section}\.{key}.*\[.+, .+\]"):
                make_robot(tree)

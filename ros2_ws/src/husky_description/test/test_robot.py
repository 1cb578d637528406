"""The numbers of the robot: names, order, geometry, masses, and what the loader refuses."""

import copy
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from husky_description.parameters import Bounds, bounds_of
from husky_description.robot import load_robot, make_robot, sections_of
from husky_description.share import share_path

SECTIONS = sections_of("drives")
TREE = yaml.safe_load(share_path("config/carbon.yaml").read_text())
NUMBERS = [
    (section, key, bounds)
    for section, kind in SECTIONS.items()
    for key, bounds in bounds_of(kind).items()
    if isinstance(bounds, Bounds)
]


def changed(section: str, key: str, value: object) -> dict:
    tree = copy.deepcopy(TREE)
    tree[section][key] = value
    return tree


def test_names_and_order():
    robot = load_robot()
    assert robot.legs == ("front_left", "front_right", "hind_left", "hind_right")
    assert robot.joint_names[:3] == (
        "front_left_hip_frontal",
        "front_left_hip_sagittal",
        "front_left_knee",
    )
    assert len(set(robot.joint_names)) == 12
    for leg, name in enumerate(robot.legs):
        assert all(joint.startswith(name) for joint in robot.joint_names[3 * leg : 3 * leg + 3])
        assert (robot.hip_position[leg, 0] > 0) == name.startswith("front")
        assert (robot.hip_position[leg, 1] > 0) == name.endswith("left")
        assert (robot.lateral_offset[leg] > 0) == name.endswith("left")


def test_masses_and_lengths_of_the_thesis():
    """Tables of chapters 2 and 5 (T1, T2)."""
    robot = load_robot()
    assert robot.mass == 7.6
    assert robot.base_mass == 5.0
    legs = 4 * (robot.hip_mass + robot.thigh_mass + robot.shin_mass)
    assert robot.base_mass + legs == pytest.approx(6.32)
    assert robot.payload_mass == pytest.approx(1.28)
    assert robot.base_inertia.tolist() == [0.0981867, 0.0844185, 0.164599]
    assert (robot.leg.ankle_link, robot.leg.thigh_link, robot.leg.calf_link) == (0.17, 0.15, 0.32)
    assert robot.thigh_length == pytest.approx(0.32)


def test_postures_put_the_feet_straight_under_the_hips():
    robot = load_robot()
    for height, posture in (
        (robot.stand_height, robot.stand_joint_position),
        (robot.sit_height, robot.sit_joint_position),
    ):
        assert np.all(posture >= robot.joint_lower) and np.all(posture <= robot.joint_upper)
        for frontal, sagittal, knee in posture.reshape(4, 3):
            x = -robot.thigh_length * math.sin(sagittal) - robot.shin_length * math.sin(
                sagittal + knee
            )
            z = robot.thigh_length * math.cos(sagittal) + robot.shin_length * math.cos(
                sagittal + knee
            )
            assert frontal == 0.0 and knee < 0.0 < sagittal
            assert x == pytest.approx(0.0, abs=1e-12)
            assert z == pytest.approx(height, abs=1e-12)


def test_joint_range_is_mirrored():
    robot = load_robot()
    lower, upper = robot.joint_lower.reshape(4, 3), robot.joint_upper.reshape(4, 3)
    for left, right in ((0, 1), (2, 3)):
        assert lower[left, 0] == -upper[right, 0] and upper[left, 0] == -lower[right, 0]
        assert np.all(lower[left, 1:] == lower[right, 1:])
        assert np.all(upper[left, 1:] == upper[right, 1:])


def test_inertias_against_sampled_solids():
    """A sum over random points of the solid; 1 % is what 2e5 points resolve."""
    robot, rng = load_robot(), np.random.default_rng(1)

    def sampled(mass, points):
        square = (points**2).mean(axis=0)
        return mass * (square.sum() - square)

    def tube(inner, outer, length, axis):
        radius = np.sqrt(rng.uniform(inner**2, outer**2, 200_000))
        angle = rng.uniform(0, 2 * np.pi, radius.size)
        along = rng.uniform(-length / 2, length / 2, radius.size)
        points = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), along))
        return np.roll(points, axis - 2, axis=1)

    leg = robot.leg
    box = rng.uniform(-0.5, 0.5, (200_000, 3)) * robot.payload.size
    hip = tube(0, leg.hip_radius, leg.hip_length, axis=1)
    shin = tube(leg.tube_inner_radius, leg.tube_outer_radius, leg.calf_link, axis=2)
    case = rng.uniform(-0.5, 0.5, (200_000, 3)) * robot.d435.size
    np.testing.assert_allclose(robot.cargo_inertia, sampled(robot.cargo_mass, box), rtol=0.01)
    np.testing.assert_allclose(robot.camera_inertia, sampled(robot.camera_mass, case), rtol=0.01)
    np.testing.assert_allclose(robot.hip_inertia, sampled(robot.hip_mass, hip), rtol=0.01)
    np.testing.assert_allclose(robot.shin_inertia, sampled(robot.shin_mass, shin), rtol=0.01)


def test_default_is_read_once_and_cannot_be_changed():
    robot = load_robot()
    assert load_robot() is robot
    with pytest.raises(ValueError, match="read-only"):
        robot.stand_joint_position[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        robot.imu.position[0] = 1.0
    with pytest.raises(AttributeError):
        robot.mass = 1.0


def test_overrides():
    assert load_robot(payload_mass=0.0).mass == pytest.approx(6.32)
    heavy = load_robot(payload_mass=2.0, servo__kp=150.0)
    assert heavy.mass == pytest.approx(8.32)
    assert heavy.payload_mass == pytest.approx(2.0)
    assert heavy.servo.kp == 150.0
    assert load_robot().servo.kp == 300.0
    with pytest.raises(ValueError, match=r"servo\.kq: unknown key"):
        load_robot(servo__kq=1.0)
    with pytest.raises(ValueError, match=r"payload_mass: -1.0 .*\[0, 50\]"):
        load_robot(payload_mass=-1.0)


def test_parameters_of_a_robot_make_the_same_robot(tmp_path: Path):
    robot = load_robot(payload_mass=0.5)
    path = tmp_path / "same.yaml"
    path.write_text(robot.parameters)
    assert load_robot(path).parameters == robot.parameters
    assert load_robot(path).payload_mass == pytest.approx(0.5)


@pytest.mark.parametrize(("section", "key", "bounds"), NUMBERS)
def test_every_number_is_checked(section, key, bounds):
    name = rf"{section}\.{key}"
    tree = copy.deepcopy(TREE)
    del tree[section][key]
    with pytest.raises(ValueError, match=f"^{name}: missing"):
        make_robot(tree)
    for wrong in (math.nan, math.inf, bounds.lower - 1.0, bounds.upper + 1.0, "1.0", True, None):
        value = [wrong] * bounds.size if bounds.size else wrong
        if bounds.integer and isinstance(wrong, float) and math.isfinite(wrong):
            value = int(wrong)
        with pytest.raises(ValueError, match=rf"^{name}.*\[.+, .+\]"):
            make_robot(changed(section, key, value))
    if bounds.size:
        with pytest.raises(ValueError, match=f"^{name}: .*list of {bounds.size}"):
            make_robot(changed(section, key, [1.0] * (bounds.size + 1)))


def makes_a_robot_or_names(tree, name):
    """Whether a robot comes of it, all finite; what is refused is refused by name."""
    try:
        robot = make_robot(tree)
    except ValueError as error:
        assert name in str(error) or "posture" in str(error) or "perch" in str(error)
        return False
    assert np.all(np.isfinite(robot.stand_joint_position))
    return True


@pytest.mark.parametrize("file", ["carbon", "beta"])
def test_either_end_of_a_range_makes_a_robot_or_is_refused_by_name(file):
    tree = yaml.safe_load(share_path(f"config/{file}.yaml").read_text())
    made = [
        makes_a_robot_or_names(
            {**tree, section: {**tree[section], key: [end] * bounds.size if bounds.size else end}},
            f"{section}.{key}",
        )
        for section, kind in sections_of(tree["actuation"]).items()
        for key, bounds in bounds_of(kind).items()
        if isinstance(bounds, Bounds)
        for end in (bounds.lower, bounds.upper)
    ]
    assert len(made) // 2 < sum(made) < len(made)


@given(
    st.sampled_from(sorted(SECTIONS)),
    st.text(alphabet="abcdefghij_", min_size=1),
    st.floats() | st.none() | st.text() | st.lists(st.floats()),
)
def test_unknown_keys_are_refused(section, key, value):
    if key in TREE[section]:
        return
    with pytest.raises(ValueError, match=rf"^{section}\.{key}: unknown key"):
        make_robot(changed(section, key, value))


@given(st.sampled_from(NUMBERS), st.floats() | st.integers())
def test_any_number_makes_a_robot_or_is_refused_by_name(number, value):
    section, key, bounds = number
    tree = changed(section, key, [value] * bounds.size if bounds.size else value)
    if makes_a_robot_or_names(tree, f"{section}.{key}"):
        assert bounds.lower <= value <= bounds.upper


def test_numbers_that_contradict_each_other():
    with pytest.raises(ValueError, match=r"gear\.rated_torque: 5 is above"):
        make_robot(changed("gear", "rated_torque", 5.0))
    with pytest.raises(ValueError, match=r"posture\.stand_height: leaves 0.7 m"):
        make_robot(changed("posture", "stand_height", 0.7))
    with pytest.raises(ValueError, match=r"body\.inertia: .* exceeds the sum"):
        make_robot(changed("body", "inertia", [0.1, 0.1, 0.3]))
    with pytest.raises(ValueError, match=r"joints\.knee: lower limit"):
        make_robot(changed("joints", "knee", [0.0, -1.0]))
    with pytest.raises(ValueError, match=r"d435\.range: least depth 3 is not below .* 2"):
        make_robot(changed("d435", "range", [3.0, 2.0]))
    with pytest.raises(ValueError, match=r"total_mass: 6.0 .*\[6.32, 100\]"):
        make_robot({**TREE, "total_mass": 6.0})


def test_files_that_are_no_robot(tmp_path: Path):
    path = tmp_path / "list.yaml"
    path.write_text("- 1\n")
    with pytest.raises(ValueError, match="not a mapping"):
        load_robot(path)
    with pytest.raises(ValueError, match=r"^wings: unknown key"):
        make_robot({**TREE, "wings": {}})
    with pytest.raises(ValueError, match=r"^leg: None is not a mapping"):
        make_robot({**TREE, "leg": None})
    with pytest.raises(ValueError, match=r"^name: 3 is not a string"):
        make_robot({**TREE, "name": 3})
    with pytest.raises(ValueError, match=r"^actuation: 'steam' is not one of drives, bus_servos"):
        make_robot({**TREE, "actuation": "steam"})
    with pytest.raises(ValueError, match=r"^motor: unknown key"):
        make_robot({**TREE, "actuation": "bus_servos"})


def test_words_are_checked():
    assert load_robot().fans.mounting == "fixed"
    assert load_robot(fans__mounting="vectoring").fans.mounting == "vectoring"
    with pytest.raises(ValueError, match=r"fans.mounting: 'glued' is not one of fixed, vectoring"):
        make_robot(changed("fans", "mounting", "glued"))


def with_rotors(**changes) -> dict:
    """Carbon's tree with other fans: by name (x, y, spin), or None for one that goes."""
    rotors = copy.deepcopy(TREE["fans"]["rotors"])
    for name, rotor in changes.items():
        rotors.pop(name, None)
        if rotor is not None:
            rotors[name] = dict(zip(("x", "y", "spin"), rotor, strict=True))
    return changed("fans", "rotors", rotors)


def test_fans_are_those_of_the_file_in_its_order():
    robot = make_robot(with_rotors(nose=(0.3, 0.0, 1.0), tail=(-0.25, 0.0, -1.0)))
    assert robot.rotor_names == (*load_robot().rotor_names, "nose", "tail")
    assert robot.fan_position[4:].tolist() == [[0.3, 0.0, robot.fans.z], [-0.25, 0.0, robot.fans.z]]
    assert robot.fans.spin.tolist() == [1.0, -1.0, -1.0, 1.0, 1.0, -1.0]
    assert robot.fans.reach.tolist() == [0.3, 0.135]
    assert load_robot("beta").rotor_names == load_robot("beta").legs


@pytest.mark.parametrize(
    ("rotors", "told"),
    [
        ({"front_left": (0.12, 0.13, 1.0)}, r"front_right: at \(0.12, -0.135\) m and none at"),
        ({"nose": (0.12, 0.1, 1.0), "nose_2": (0.12, -0.1, -1.0)}, "overlap"),
        ({"front_left": (0.12, 0.135, -1.0)}, "as many one way as the other"),
        ({"front_left": (0.12, 0.135, 0.5)}, r"spin is .*0.5.*: each is 1 or -1"),
        (
            {"hind_left": (-0.12, 0.135, 1.0), "front_right": (0.12, -0.135, -1.0)}
            | {"front_left": (0.12, 0.135, 1.0), "hind_right": (-0.12, -0.135, -1.0)},
            "cannot make roll, pitch and yaw apart",
        ),
        ({"hind_left": None, "hind_right": None}, "not a mapping of 4 to 8 sections by name"),
        (
            {"hind_left": None, "hind_right": None} | {"tail": (-0.2, 0.0, 1.0)},
            "not a mapping of 4 to 8 sections by name",
        ),
        ({"Nose": (0.3, 0.0, 1.0)}, "'Nose' is not a name of a-z"),
        ({"nose": (1.3, 0.0, 1.0)}, r"\.nose\.x: 1.3 is outside the allowed range"),
        ({"nose": (math.nan, 0.0, 1.0)}, r"\.nose\.x: nan is outside the allowed range"),
    ],
)
def test_fans_that_cannot_be_are_refused_by_name(rotors, told):
    with pytest.raises(ValueError, match=rf"^fans\.rotors.*{told}"):
        make_robot(with_rotors(**rotors))


def test_fans_are_a_mapping_of_sections():
    for value in (None, [1.0], {"a": 1, "b": 2, "c": 3}):
        with pytest.raises(ValueError, match=r"^fans\.rotors"):
            make_robot(changed("fans", "rotors", value))
    rotors = {**TREE["fans"]["rotors"], "nose": {"x": 0.3, "y": 0.0}}
    with pytest.raises(ValueError, match=r"^fans\.rotors\.nose\.spin: missing"):
        make_robot(changed("fans", "rotors", rotors))


def test_a_robot_that_there_is_not_is_named_with_those_that_there_are(tmp_path):
    for name in ("gamma", str(tmp_path / "none.yaml"), str(tmp_path)):
        told = f"robot is '{name}', it must be one of carbon, beta or the path of a file"
        with pytest.raises(ValueError, match=told):
            load_robot(name)
    path = tmp_path / "bad.yaml"
    for content in (b"a: [1", b"\xff\xfe\xff"):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"bad\.yaml: not YAML"):
            load_robot(path)

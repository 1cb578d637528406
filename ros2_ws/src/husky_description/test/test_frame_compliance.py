"""The frame that bends (T6), as it is simulated, against closed forms of a mass on springs."""

import numpy as np
import pytest

from husky_description import frame_compliance
from husky_description.gravity import GRAVITY
from husky_description.mujoco_model import build_spec
from husky_description.plain_mujoco import mujoco
from husky_description.robot import ROBOTS, load_robot

RIGID = {"solref": [0.0004, 1.0], "solimp": [0.9999, 0.9999, 0.001, 0.5, 2.0]}
STEP = 1e-4  # s, at which `RIGID` is


class Standing:
    """A robot with locked joints and feet that hold fast: its body can move on the frame alone."""

    def __init__(self, name, frequency, damping_ratio=0.05):
        self.robot = load_robot(
            name, frame__frequency=frequency, frame__damping_ratio=damping_ratio
        )
        spec = build_spec(self.robot, bending=True)
        spec.option.timestep = STEP
        for joint, angle in zip(
            self.robot.joint_names, self.robot.stand_joint_position, strict=True
        ):
            held = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=joint, **RIGID)
            held.data[0] = angle
        for leg in self.robot.legs:
            spec.add_equality(
                type=mujoco.mjtEq.mjEQ_WELD,
                objtype=mujoco.mjtObj.mjOBJ_BODY,
                name=leg,
                name1=f"{leg}_shin",
                name2="world",
                **RIGID,
            )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("stand").id)
        mujoco.mj_kinematics(self.model, self.data)
        for leg in self.robot.legs:
            shin, row = self.data.body(f"{leg}_shin"), self.model.equality(leg).data
            row[:3], row[3:6] = shin.xpos, 0.0
            mujoco.mju_negQuat(row[6:10], shin.xquat)

    def move(self, duration):
        """Let time pass; return how the body's place goes over it [m] (n, 3)."""
        places = []
        for _ in range(round(duration / STEP)):
            mujoco.mj_step(self.model, self.data)
            places.append(self.data.qpos[:3].copy())
        return np.array(places)


def decay(signal, step):
    """Return frequency [Hz] and damping ratio of a free decay, by its first peaks."""
    peaks = np.flatnonzero((signal[1:-1] > signal[:-2]) & (signal[1:-1] >= signal[2:])) + 1
    peaks = peaks[signal[peaks] > 0.05 * signal.max()]
    rounds = len(peaks) - 1
    shrinking = np.log(signal[peaks[0]] / signal[peaks[-1]]) / (2.0 * np.pi * rounds)
    ratio = shrinking / np.hypot(1.0, shrinking)
    rate = 2.0 * np.pi * rounds / ((peaks[-1] - peaks[0]) * step)
    return rate / (2.0 * np.pi) / np.sqrt(1.0 - ratio**2), ratio


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("name", "frequency", "ratio"), [("carbon", 15, 0.05), ("beta", 30, 0.1)])
def test_standing_robot_that_is_tapped_swings_as_its_file_says(name, frequency, ratio, axis):
    standing = Standing(name, frequency, ratio)
    standing.model.opt.gravity[:] = 0.0  # the tap's decay alone, not that of the sinking
    standing.data.qvel[axis] = 0.05
    way = standing.move(8.0 / frequency)[:, axis]
    found, damped = decay(way - standing.model.key("stand").qpos[axis], STEP)
    assert found == pytest.approx(frequency, rel=0.05)
    assert damped == pytest.approx(ratio, rel=0.05)


@pytest.mark.parametrize(("name", "frequency"), [("carbon", 10.0), ("beta", 20.0)])
def test_body_sinks_under_its_weight_by_what_the_frequency_says(name, frequency):
    standing = Standing(name, frequency, 1.0)
    sunk = standing.data.qpos[2] - standing.move(1.0)[-1, 2]
    assert sunk == pytest.approx(GRAVITY / (2.0 * np.pi * frequency) ** 2, rel=0.05)
    forces = [
        -standing.model.joint(f"{leg}_frame_z").stiffness[0]
        * standing.data.joint(f"{leg}_frame_z").qpos[0]
        for leg in standing.robot.legs
    ]
    carried = 4.0 * frame_compliance.loaded_mass(standing.robot) * GRAVITY
    assert -np.sum(forces) == pytest.approx(carried, rel=0.01)


class Afloat:
    """A limp robot in empty space, its hips off the middle of their springs; `start` is energy."""

    def __init__(self, name, frequency, damping_ratio, spin):
        robot = load_robot(name, frame__frequency=frequency, frame__damping_ratio=damping_ratio)
        spec = build_spec(robot, bending=True)
        spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        spec.option.gravity = [0.0, 0.0, 0.0]
        self.model = spec.compile()
        self.model.jnt_limited[:] = 0  # stops take energy
        self.data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("stand").id)
        rng = np.random.default_rng(1)
        for leg in robot.legs:
            for axis in frame_compliance.AXES:
                self.data.joint(f"{leg}_frame_{axis}").qpos[0] = rng.uniform(-0.002, 0.002)
        self.data.qvel[3:6] = spin
        mujoco.mj_forward(self.model, self.data)
        self.start = self.data.energy.sum()

    def energies(self, duration):
        """Return the energy after each step [J]."""
        found = []
        for _ in range(round(duration / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)
            found.append(self.data.energy.sum())
        return np.array(found)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("frequency", [10.0, 40.0])
def test_energy_of_a_frame_that_swings_does_not_grow(name, frequency):
    kept = Afloat(name, frequency, 0.0, 0.0).energies(10.0)
    assert kept[-2000:].mean() == pytest.approx(kept[:2000].mean(), rel=0.005)
    tumbling = Afloat(name, frequency, 0.05, 1.0)
    assert tumbling.energies(2.0).max() <= tumbling.start


@pytest.mark.parametrize("name", ROBOTS)
def test_stiff_frame_has_no_joints_and_links_weigh_the_same_when_it_bends(name):
    robot = load_robot(name, frame__frequency=15.0)
    stiff = build_spec(robot).compile()
    assert stiff.nv == 18
    assert build_spec(load_robot(name), bending=True).compile().nv == 18
    bent = build_spec(robot, bending=True).compile()
    assert (bent.nv, bent.nu) == (30, 12)
    np.testing.assert_array_equal(bent.body_mass, stiff.body_mass)
    np.testing.assert_array_equal(bent.geom_pos, stiff.geom_pos)
    data, bent_data = mujoco.MjData(stiff), mujoco.MjData(bent)
    for model, state in ((stiff, data), (bent, bent_data)):
        mujoco.mj_resetDataKeyframe(model, state, model.key("sit").id)
        mujoco.mj_kinematics(model, state)
    np.testing.assert_allclose(bent_data.site_xpos, data.site_xpos, atol=1e-12)


@pytest.mark.parametrize("frequency", [9.9, 1e-9, 41.0, -1.0, "soft"])
def test_frame_that_is_too_soft_or_no_number_is_refused(frequency):
    with pytest.raises(ValueError, match=r"frame\.frequency: .*(\[10, 40\]|\[0, 40\])"):
        load_robot(frame__frequency=frequency)

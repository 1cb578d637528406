"""Ground that gives way (T27) against closed forms: the same numbers whatever stands on it."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from husky_description.ground import GROUND_PRESETS, GroundModel
from husky_description.robot import load_robot
from husky_sim.scene import WorldOptions, build_scene, physics_step
from husky_sim.soft_ground import SoftGround

GRAVITY, STEP, RADIUS = 9.81, 0.0005, 0.05
LAB = GROUND_PRESETS["lab"]
BOX = """
<mujoco>
  <option timestep="0.0005" cone="elliptic"><flag island="disable"/></option>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 0.1"/>
    <body pos="0 0 0.05">
      <freejoint/>
      <geom name="box" type="box" size="0.1 0.1 0.05" mass="3"/>
      <geom name="knob" type="box" size="0.05 0.05 0.0505" mass="0"/>
    </body>
  </worldbody>
</mujoco>
"""


class Body:
    """A block that does not turn, on a ball at its centre of mass, on a plane."""

    def __init__(
        self,
        ground: GroundModel,
        mass: float,
        tilt: float = 0.0,
        height: float = 0.0,
        weld: bool = False,
    ):
        """Touch the ground, or be `height` above it [m].

        Args:
            ground: its numbers.
            mass: [kg].
            tilt: of the plane, down along +x [rad].
            height: [m].
            weld: hold the body where it is.
        """
        self.mass = mass
        spec = mujoco.MjSpec()
        spec.option.timestep, spec.option.cone = STEP, mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
        spec.option.gravity = [GRAVITY * math.sin(tilt), 0.0, -GRAVITY * math.cos(tilt)]
        spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.1]
        )
        body = spec.worldbody.add_body(name="block", pos=[0.0, 0.0, RADIUS + height])
        for axis in np.eye(3):
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        body.add_geom(name="foot", size=[RADIUS, 0.0, 0.0], mass=mass)
        if weld:
            spec.add_equality(
                type=mujoco.mjtEq.mjEQ_WELD,
                objtype=mujoco.mjtObj.mjOBJ_BODY,
                name1="block",
                name2="world",
                solref=[0.004, 1.0],
            )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.ground = SoftGround(self.model, ground, "floor")

    def run(self, duration: float) -> None:
        """Advance [s]."""
        for _ in range(round(duration / STEP)):
            self.ground.step(self.model, self.data)


# The ground of the thesis's model takes seconds to give way; the others do so with every mass.
@pytest.mark.parametrize(
    ("name", "mass"),
    [
        pytest.param(name, mass, marks=[pytest.mark.slow] * (name == "thesis_model" and mass > 0.5))
        for mass in (0.5, 2.0, 5.0)
        for name in GROUND_PRESETS
    ],
)
def test_a_ball_sinks_by_its_weight_over_the_stiffness(name, mass):
    ground = GROUND_PRESETS[name]
    body = Body(ground, mass)
    settled = mass * GRAVITY / ground.stiffness
    pace = ground.damping / ground.stiffness
    body.run(max(1.0, 6.0 * pace) if pace < 1.0 else pace)
    expected = settled if pace < 1.0 else settled * (1.0 - math.exp(-1.0))
    assert -body.data.qpos[2] == pytest.approx(expected, rel=0.01)


def test_a_lifted_ball_is_not_pulled_back():
    body = Body(LAB, 2.0)
    body.run(0.5)
    body.data.qvel[2] = 1.0  # faster out than the spring pushes: k1 |z| < k2 v
    before = body.data.qvel[2]
    body.run(STEP)
    assert body.data.qvel[2] == pytest.approx(before - GRAVITY * STEP)


def test_a_fast_impact_is_damped_and_never_gains_energy():
    body = Body(LAB, 2.0, height=0.05)
    energies = []
    for _ in range(600):
        body.run(STEP)
        speed, height = body.data.qvel[2], body.data.qpos[2] + 0.05
        spring = 0.5 * LAB.stiffness * min(0.0, height) ** 2
        energies.append(body.mass * (0.5 * speed**2 + GRAVITY * height) + spring)
    # The step into the ground is a step of free fall, up to 0.5 mm deep.
    deepest = 0.5 * LAB.stiffness * (STEP * 1.0) ** 2
    assert np.diff(energies).max() < deepest and abs(energies[-1]) < 0.05 * energies[0]


def test_a_block_sticks_below_static_friction_and_slides_above():
    """On a slope the static coefficient decides, then the Coulomb one: g (sin a - mu_c cos a)."""
    ground = replace(LAB, friction_viscous=0.0)
    tilt = math.atan(0.99 * ground.friction_static)
    sunk = 2.0 * GRAVITY * math.cos(tilt) / ground.stiffness  # it slides while it sinks, else
    held = Body(ground, 2.0, tilt=tilt, height=-sunk)
    held.run(0.5)
    assert abs(held.data.qpos[0]) < 2e-4
    tilt = math.atan(1.01 * ground.friction_static)
    sliding = Body(ground, 2.0, tilt=tilt)
    sliding.run(0.5)
    start, duration = sliding.data.qvel[0], 0.5
    assert start > ground.stribeck_velocity
    sliding.run(duration)
    pull = GRAVITY * (math.sin(tilt) - ground.friction_coulomb * math.cos(tilt))
    assert sliding.data.qvel[0] - start == pytest.approx(pull * duration, rel=0.01)


@pytest.mark.parametrize("mass", [0.5, 5.0])
def test_a_pushed_block_slides_to_rest_as_the_closed_form_does(mass):
    """Coulomb and viscous friction: m v' = -mu_c m g - mu_v v, in any direction."""
    body = Body(LAB, mass)
    body.run(0.5)
    speed = 1.0
    body.data.qvel[:2] = 0.6 * speed, -0.8 * speed
    start = body.data.qpos[:2].copy()
    pace, terminal = LAB.friction_viscous / mass, LAB.friction_coulomb * mass * GRAVITY
    terminal /= LAB.friction_viscous
    stop = math.log1p(speed / terminal) / pace
    body.run(stop / 2)
    slower = (speed + terminal) * math.exp(-pace * stop / 2) - terminal
    np.testing.assert_allclose(body.data.qvel[:2], [0.6 * slower, -0.8 * slower], rtol=0.01)
    # The block does not rise while it slides.
    assert -body.data.qpos[2] == pytest.approx(mass * GRAVITY / LAB.stiffness, rel=0.01)
    body.run(stop / 2 + 0.1)
    way = (speed + terminal) / pace * (1.0 - math.exp(-pace * stop)) - terminal * stop
    np.testing.assert_allclose(body.data.qpos[:2] - start, [0.6 * way, -0.8 * way], rtol=0.01)
    assert np.abs(body.data.qvel[:2]).max() < 1e-6


def test_contact_points_of_one_body_share_its_spring():
    """A box with a flat knob under it sinks as deep as a ball of its weight, on the knob alone."""
    spec = mujoco.MjSpec.from_string(BOX)
    model = spec.compile()
    data, ground = mujoco.MjData(model), SoftGround(model, LAB, "floor")
    for _ in range(2000):
        ground.step(model, data)
    assert data.ncon > 4  # four corners, and the knob under it is the deepest
    assert -data.contact.dist.min() == pytest.approx(3.0 * GRAVITY / LAB.stiffness, rel=0.01)
    forces = np.zeros((data.ncon, 6))
    for index in range(data.ncon):
        mujoco.mj_contactForce(model, data, index, forces[index])
    knob = data.contact.geom[:, 1] == model.geom("knob").id
    assert forces[knob, 0].sum() == pytest.approx(3.0 * GRAVITY, rel=0.01)
    assert not forces[~knob].any()


def test_what_else_holds_a_body_takes_its_part():
    """Held in place by a weld, a ball presses with k1 times its depth, not with its weight."""
    body = Body(LAB, 2.0, weld=True, height=-0.01)
    body.run(0.3)
    force = np.zeros(6)
    mujoco.mj_contactForce(body.model, body.data, 0, force)
    assert force[0] == pytest.approx(LAB.stiffness * 0.01, rel=0.02)


def test_refuses_models_that_it_cannot_serve():
    model = mujoco.MjSpec.from_string("<mujoco/>").compile()
    with pytest.raises(ValueError, match="elliptic cones"):
        SoftGround(model, LAB, "floor")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stiffness": 300.0}, "contact is 'stiff', which has none: it must be one of lab"),
        ({"contact": "lab", "stiffness": 0.5}, "stiffness is 0.5 N/m, it must be within 1 and 1e6"),
    ],
)
def test_a_stiffness_that_no_ground_has_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        WorldOptions(**options)


def test_a_stiffness_and_a_friction_replace_those_of_the_preset():
    options = WorldOptions(contact="thesis_model", stiffness=300.0, friction=0.4)
    model = build_scene(load_robot("beta"), options).compile()
    ground = physics_step(model, options).__self__.ground
    assert (ground.stiffness, ground.damping) == (300.0, 1000.0)
    assert ground.friction_static == ground.friction_coulomb == 0.4

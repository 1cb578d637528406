"""The scene: the robot in its world of ground, light and sky, as a MuJoCo specification."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from husky_description.gantry import GantryOptions
from husky_description.ground import GROUND_PRESETS
from husky_description.mujoco_model import build_spec, build_unit_spec
from husky_description.plain_mujoco import mujoco
from husky_description.robot import Robot
from husky_runtime.graph import BODIES, TICK_PERIOD_NS
from husky_sim import terrain
from husky_sim.gantry import add_gantry
from husky_sim.propulsion.fans_in_world import add_autopilot
from husky_sim.soft_ground import SoftGround

GROUND_COLOURS = {
    "ground": ((0.93, 0.93, 0.92), (0.86, 0.87, 0.88)),
    "tile": ((0.80, 0.76, 0.68), (0.74, 0.70, 0.62)),
}
"""Both colours of the squares of each material of the ground."""
HOLD = "hold"
"""Name of the equality that holds the base in place."""


STIFF = "stiff"
"""Contact preset of a hard floor: MuJoCo's own contact, about 6.6e4 N/m under Carbon."""
_STIFF_SOLREF = (0.005, 1.0)
"""Time constant [s] and damping ratio of the hard floor."""
_STIFF_FRICTION = 0.7
"""Friction coefficient of the hard floor (thesis ch. 5)."""
CONTACT_PRESETS = (STIFF, *GROUND_PRESETS)
"""A hard floor, and the sets of T27, of which those of the thesis disagree."""


@dataclass(frozen=True)
class WorldOptions:
    """What world to build.

    Attributes:
        terrain: the ground.
        contact: one of `CONTACT_PRESETS`.
        friction: friction coefficient, static and sliding, or None for the preset's.
        stiffness: of a foot on a preset of T27 [N/m], or None for the preset's.
        timestep: physics step [s]; must divide the tick of 2 ms.
        keyframe: initial posture, "sit" or "stand".
        seed: of terrain and devices.
        body: one of `husky_runtime.graph.BODIES`.
        gantry: the gantry over it, or None.
        start_height: added to the keyframe's height [m], to hang in the ropes, say.
        start_distance: where the robot starts, along the ground's surface from x = 0 [m]; it stands
            or sits there as the keyframe says, upright on the surface.
        start_held: the base is held in place from the start on, until it is released.
    """

    terrain: terrain.TerrainOptions = field(default_factory=terrain.TerrainOptions)
    contact: str = "stiff"
    friction: float | None = None
    stiffness: float | None = None
    timestep: float = 0.0005
    keyframe: str = "sit"
    seed: int = 0
    body: str = "robot"
    gantry: GantryOptions | None = None
    start_height: float = 0.0
    start_distance: float = 0.0
    start_held: bool = False

    def __post_init__(self) -> None:
        """Raise ValueError for what cannot be simulated: its name, value, what is allowed."""
        if self.contact not in CONTACT_PRESETS:
            raise ValueError(
                f"contact is {self.contact!r}, it must be one of {', '.join(CONTACT_PRESETS)}"
            )
        if self.body not in BODIES:
            raise ValueError(f"body is {self.body!r}, it must be one of {', '.join(BODIES)}")
        if not 0.0 <= self.start_height <= 5.0:
            raise ValueError(f"start_height is {self.start_height} m, it must be within 0 and 5")
        if not 0.0 <= self.start_distance <= 200.0:
            raise ValueError(
                f"start_distance is {self.start_distance} m, it must be within 0 and 200"
            )
        if self.friction is not None and not 0.0 < self.friction <= 5.0:
            raise ValueError(f"friction is {self.friction}, it must be above 0 and at most 5")
        if self.stiffness is not None and self.contact == STIFF:
            raise ValueError(
                f"stiffness is {self.stiffness} N/m, but contact is {STIFF!r}, which has none: it "
                f"must be one of {', '.join(GROUND_PRESETS)}"
            )
        if self.stiffness is not None and not 1.0 <= self.stiffness <= 1e6:
            raise ValueError(f"stiffness is {self.stiffness} N/m, it must be within 1 and 1e6")
        ticks = TICK_PERIOD_NS / 1e9 / self.timestep if self.timestep > 0 else 0.0
        if not 1.0 <= ticks <= 100.0 or abs(ticks - round(ticks)) > 1e-9:
            raise ValueError(
                f"timestep is {self.timestep} s, it must divide the tick of 2 ms: 0.002, 0.001, "
                "0.0005, 0.00025, ..."
            )


def build_scene(robot: Robot, options: WorldOptions) -> mujoco.MjSpec:
    """Return the robot in its world: ground, light, sky."""
    unit = options.body == "unit"
    spec = build_unit_spec(robot) if unit else build_spec(robot, bending=True)
    spec.option.timestep = options.timestep
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.5, 0.5, 0.5]
    spec.visual.global_.offwidth = 1280
    spec.visual.global_.offheight = 720
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.75, 0.83, 0.92],
        rgb2=[1.0, 1.0, 1.0],
        width=256,
        height=256,
    )
    for name, colours in GROUND_COLOURS.items():
        _ground_material(spec, name, *colours)
    spec.worldbody.add_light(
        pos=[0.0, 0.0, 4.0],
        dir=[0.3, 0.2, -1.0],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        castshadow=True,
    )
    for name, kind in (
        ("imu_orientation", mujoco.mjtSensor.mjSENS_FRAMEQUAT),
        ("imu_gyro", mujoco.mjtSensor.mjSENS_GYRO),
        ("imu_accelerometer", mujoco.mjtSensor.mjSENS_ACCELEROMETER),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")
    if options.body != "robot":
        add_autopilot(spec, robot)
    if options.gantry is not None:
        add_gantry(spec, options.gantry)
    spec.add_equality(
        name=HOLD,
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1="base",
        name2="world",
        active=False,
        solref=[0.004, 1.0],
    )
    terrain.build(spec, options.terrain, options.seed)
    friction = _STIFF_FRICTION if options.friction is None else options.friction
    for geom in spec.geoms:
        if geom.name.startswith(terrain.FLOOR):
            # The ground decides alone (priority), so that one number is the friction of a run.
            geom.priority = 1
            geom.condim = 3
            geom.friction = [friction, 0.005, 0.0001]
            geom.solref = list(_STIFF_SOLREF)
    return spec


PhysicsStep = Callable[[mujoco.MjModel, mujoco.MjData], None]


def physics_step(model: mujoco.MjModel, options: WorldOptions) -> PhysicsStep:
    """Return the function that advances a scene's model by one physics step, as `mj_step` does."""
    if options.contact == STIFF:
        step: PhysicsStep = mujoco.mj_step
        return step
    changes: dict[str, Any] = {}
    if options.friction is not None:
        changes |= {"friction_coulomb": options.friction, "friction_static": options.friction}
    if options.stiffness is not None:
        changes["stiffness"] = options.stiffness
    ground = replace(GROUND_PRESETS[options.contact], **changes)
    soft = SoftGround(model, ground, terrain.FLOOR)
    buried = mujoco.MjData(model)
    buried.qpos[2] = 0.0
    soft.step(model, buried)  # compiles its functions: not in the first tick
    return soft.step


Colour = tuple[float, float, float]


def _ground_material(spec: mujoco.MjSpec, name: str, first: Colour, second: Colour) -> None:
    """A checkered material with squares of 0.5 m."""
    spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=first,
        rgb2=second,
        width=512,
        height=512,
    )
    material = spec.add_material(name=name, texrepeat=[1.0, 1.0], texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name

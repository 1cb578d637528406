"""The robot as a MuJoCo model specification, laid out like a MuJoCo Menagerie model.

`python -m husky_description.mujoco_model [carbon|beta] > robot.xml` writes it as MJCF.
"""

import argparse
import math

import numpy as np
from numpy.typing import ArrayLike

from husky_description.arrays import Array
from husky_description.frame_compliance import AXES, add_springs
from husky_description.gravity import GRAVITY
from husky_description.inertia import box_inertia
from husky_description.look import (
    base_look,
    camera_look,
    hip_look,
    knee_pod_look,
    propeller_rpy,
    unit_look,
)
from husky_description.mujoco_look import VISUAL_GROUP, add_look, add_materials, add_parallelograms
from husky_description.plain_mujoco import mujoco
from husky_description.robot import ROBOTS, Robot, load_robot
from husky_description.rotation import from_roll_pitch_yaw
from husky_description.rotor_geometry import flight_posture

TIMESTEP = 0.0005  # s

BLADE_HEIGHT = 0.010
"""Of the disc that a propeller's blades sweep and collide as [m]."""

COLLISION_GROUP = 3
SITE_GROUP = 4

_JOINT_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0))


def build_spec(robot: Robot, *, bending: bool = False) -> mujoco.MjSpec:
    """Make the robot alone, on a free joint in an empty world, to be extended by a scene.

    Args:
        robot: its numbers.
        bending: let the frame bend as the robot's `frame` says, see `frame_compliance`; without it,
            or with a stiff frame, qpos[7:] and qvel[6:] are the joints.

    Bodies: `base`, `<leg>_hip`, `<leg>_thigh`, `<leg>_shin`, and, welded to the base, `camera`, the
    depth camera, and `payload`, the rest of the payload; with propellers at the knees also
    `<leg>_knee_pod`, welded to the thigh.
    Joints: `floating_base`, then the twelve of `robot.joint_names`, in that order; where the frame
    bends, three more before those of each leg. Actuators: one `motor` per joint, named and ordered
    as the joints, of gear 1, so that ctrl (12,) is the joint torque [N m], clipped only beyond
    what an actuator can give. Sites: `imu`, `t265`, `d435` (camera_link, x along the view),
    `perch`, `<leg>_foot` (centre of the sphere), and `<fan>_fan` or `<leg>_propeller` (z along the
    thrust). Keyframes: `sit` and `stand`.

    Geoms that are seen are in group 2 and without mass or contact, geoms that collide in group 3;
    the links of the legs are seen as skins, see `mujoco_look`.
    Inertias are given, never computed from geoms. Contact parameters stand in the main default
    class, so that a floor added to this specification inherits them; a geom with other friction
    needs `priority=1`, because MuJoCo takes the larger friction of a pair otherwise.

    Options and their reasons: step 0.5 ms (a joint PD of 300 N m/rad is far from its stability
    limit and contacts of 5 ms are resolved by ten steps); Euler, because implicitfast has nothing
    to gain and costs 5 % more: the only force that depends on velocity is the frame's damping, and
    both take that implicitly; elliptic cone and impratio 100, because the defaults creep 25-45 mm/s
    on a slope of 20-25 deg and these 0.1 mm/s; Newton, which needs one iteration when standing; no
    constraint islands, of which a single robot is one.
    """
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    _set_options(spec)
    _add_defaults(spec, robot)
    add_materials(spec)
    base = _add_base(spec, robot)
    bending = bending and robot.frame.frequency > 0.0
    for leg in range(4):
        _add_leg(spec, base, robot, leg, bending)
    add_parallelograms(spec, robot)
    for leg in range(4):
        for joint in range(3):
            _add_motor(spec, robot, 3 * leg + joint)
    for name, height, joints in (
        ("sit", robot.sit_height, robot.sit_joint_position),
        ("stand", robot.stand_height, robot.stand_joint_position),
    ):
        legs = joints.reshape(4, 3)
        if bending:
            legs = np.pad(legs, ((0, 0), (len(AXES), 0)))  # the hips where they are without load
        base_pose = [0.0, 0.0, height + robot.foot_radius, 1.0, 0.0, 0.0, 0.0]
        spec.add_key(name=name, qpos=np.append(base_pose, legs), ctrl=np.zeros(joints.size))
    return spec


def build_unit_spec(robot: Robot) -> mujoco.MjSpec:
    """Make the propulsion unit alone, as `base` on a free joint, with sites as in `build_spec`.

    It has the fans' and the payload's mass, the latter as a box between the fans; it stands on its
    frame, without the depth camera. Keyframe `stand`: on the ground.
    """
    spec = mujoco.MjSpec()
    spec.modelname = f"{robot.name}_unit"
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    _set_options(spec)
    _add_defaults(spec, robot)
    add_materials(spec)
    fans = robot.fans
    base = spec.worldbody.add_body(name="base", pos=[0, 0, 0])
    base.childclass = robot.name
    base.add_freejoint(name="floating_base")
    # All of the payload's mass belongs to the unit: half of it in the box, half in the fans.
    half = robot.payload_mass / 2
    middle = float(fans.place[:, 0].mean()) / 2  # of all mass; left and right are alike
    x, y = np.mean((fans.place - (middle, 0.0)) ** 2, axis=0) + (middle**2, 0.0)
    inertia = box_inertia(half, robot.payload.size) + half * np.array([y, x, x + y])
    _set_inertia(base, 2 * half, [middle, 0.0, fans.z], inertia)
    bottom = fans.z - fans.height / 2
    half_sizes = np.append(fans.reach + fans.outer_radius, fans.height / 2)
    _add_collision(
        spec, base, "unit", mujoco.mjtGeom.mjGEOM_BOX, size=half_sizes, pos=[0.0, 0.0, fans.z]
    )
    carbon = spec.find_default(robot.name)
    base.add_site(carbon, name="imu", pos=robot.imu.position, quat=_quaternion(robot.imu.rpy))
    base.add_site(carbon, name="t265", pos=robot.t265.position, quat=_quaternion(robot.t265.rpy))
    for name, position in zip(robot.rotor_names, robot.fan_position, strict=True):
        base.add_site(carbon, name=f"{name}_fan", pos=position)
    add_look(spec, base, "base", unit_look(robot))
    spec.add_key(name="stand", qpos=[0.0, 0.0, -bottom, 1.0, 0.0, 0.0, 0.0])
    return spec


def composite_inertia(robot: Robot, body: str = "robot") -> tuple[Array, Array]:
    """Return centre of mass and inertia of everything as it flies, as one rigid body.

    Args:
        robot: its numbers.
        body: `unit`, or anything else for the robot, standing or, with propellers, splayed.

    Returns:
        Centre of mass in base [m] (3,), and the inertia about it along the base's axes
        [kg m^2] (3, 3).
    """
    spec = build_unit_spec(robot) if body == "unit" else build_spec(robot)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    if robot.legs_carry_propellers:
        data.qpos[7:] = flight_posture(robot)
    mujoco.mj_forward(model, data)
    base = model.body("base").id
    inertia = np.zeros((3, 3))
    for index in range(base, model.nbody):
        offset = data.xipos[index] - data.subtree_com[base]
        axes = data.ximat[index].reshape(3, 3)
        own = axes * model.body_inertia[index] @ axes.T
        far = offset @ offset * np.eye(3) - np.outer(offset, offset)
        inertia += own + model.body_mass[index] * far
    return data.subtree_com[base] - data.xpos[base], 0.5 * (inertia + inertia.T)


def flying_inertia(robot: Robot, body: str) -> tuple[float, float, float]:
    """Return the inertia about roll, pitch and yaw through the centre of mass [kg m^2].

    Args:
        robot: its numbers.
        body: see `composite_inertia`.
    """
    _, inertia = composite_inertia(robot, body)
    roll, pitch, yaw = (round(float(value), 4) for value in np.diag(inertia))
    return roll, pitch, yaw


def _set_options(spec: mujoco.MjSpec) -> None:
    option = spec.option
    option.timestep = TIMESTEP
    option.gravity = [0.0, 0.0, -GRAVITY]
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 100.0
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND


def _add_defaults(spec: mujoco.MjSpec, robot: Robot) -> None:
    contact = robot.contact
    main = spec.default
    main.geom.friction = [contact.friction, contact.friction_torsional, contact.friction_rolling]
    main.geom.solref = [contact.time_constant, contact.damping_ratio]
    main.geom.condim = 3

    carbon = spec.add_default(robot.name, main)
    carbon.joint.armature = float(robot.armature[0])
    carbon.actuator.gear[0] = 1.0
    carbon.actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    carbon.actuator.ctrlrange = [-robot.joint_torque_bound, robot.joint_torque_bound]

    carbon.site.group = SITE_GROUP
    carbon.site.size = [0.008, 0.008, 0.008]

    visual = spec.add_default("visual", carbon)
    visual.geom.group = VISUAL_GROUP
    visual.geom.contype = 0
    visual.geom.conaffinity = 0
    visual.geom.mass = 0.0

    collision = spec.add_default("collision", carbon)
    collision.geom.group = COLLISION_GROUP
    collision.geom.mass = 0.0
    collision.geom.rgba = [0.9, 0.4, 0.1, 0.4]

    for row, joint in enumerate(robot.leg_joints):
        spec.add_default(joint, carbon).joint.axis = _JOINT_AXES[row]


def _add_base(spec: mujoco.MjSpec, robot: Robot) -> mujoco.MjsBody:
    base = spec.worldbody.add_body(name="base", pos=[0, 0, robot.stand_height + robot.foot_radius])
    base.childclass = robot.name
    _set_inertia(base, robot.base_mass, robot.body.center_of_mass, robot.base_inertia)
    base.add_freejoint(name="floating_base")
    if robot.cargo_mass > 0.0:
        payload = base.add_body(name="payload", pos=robot.cargo_center)
        _set_inertia(payload, robot.cargo_mass, np.zeros(3), robot.cargo_inertia)
    _add_camera(spec, base, robot)

    for name, box in (
        ("torso", robot.torso),
        ("rack", robot.rack),
        ("perch", robot.perch),
        ("perch_struts", robot.perch_struts),  # no leg gets between perch and torso
    ):
        _add_collision(
            spec, base, name, mujoco.mjtGeom.mjGEOM_BOX, size=box.size / 2, pos=box.position
        )
    carbon = spec.find_default(robot.name)
    base.add_site(carbon, name="imu", pos=robot.imu.position, quat=_quaternion(robot.imu.rpy))
    base.add_site(carbon, name="t265", pos=robot.t265.position, quat=_quaternion(robot.t265.rpy))
    bottom = robot.perch.position - [0, 0, robot.perch.size[2] / 2]
    base.add_site(carbon, name="perch", pos=bottom)
    if not robot.legs_carry_propellers:
        for name, position in zip(robot.rotor_names, robot.fan_position, strict=True):
            base.add_site(carbon, name=f"{name}_fan", pos=position)
    add_look(spec, base, "base", base_look(robot))
    return base


def _add_camera(spec: mujoco.MjSpec, base: mujoco.MjsBody, robot: Robot) -> None:
    """Depth camera, fixed to the base; without mass where there is no payload."""
    camera = robot.d435
    body = base.add_body(name="camera", pos=camera.position, quat=_quaternion(camera.rpy))
    _set_inertia(body, robot.camera_mass, -camera.depth_offset, robot.camera_inertia)
    body.add_site(spec.find_default(robot.name), name="d435")
    add_look(spec, body, "camera", camera_look(robot))


def _add_leg(
    spec: mujoco.MjSpec, base: mujoco.MjsBody, robot: Robot, leg: int, bending: bool
) -> None:
    name = robot.legs[leg]
    offset = [0.0, robot.lateral_offset[leg], 0.0]
    down = np.array([0.0, 0.0, -1.0])

    hip = base.add_body(name=f"{name}_hip", pos=robot.hip_position[leg])
    _set_inertia(hip, robot.hip_mass, offset, robot.hip_inertia)
    thigh = hip.add_body(name=f"{name}_thigh", pos=offset)
    _set_inertia(thigh, robot.thigh_mass, down * robot.thigh_length / 2, robot.thigh_inertia)
    shin = thigh.add_body(name=f"{name}_shin", pos=down * robot.thigh_length)
    _set_inertia(shin, robot.shin_mass, down * robot.shin_length / 2, robot.shin_inertia)

    if bending:
        add_springs(hip, name, robot)
    for row, body in enumerate((hip, thigh, shin)):
        joint = 3 * leg + row
        body.add_joint(
            spec.find_default(robot.leg_joints[row]),
            name=robot.joint_names[joint],
            range=[robot.joint_lower[joint], robot.joint_upper[joint]],
        )

    radius = robot.leg.tube_outer_radius
    _add_collision(
        spec,
        hip,
        f"{name}_hip",
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[robot.leg.hip_radius, robot.leg.hip_length / 2, 0],
        pos=offset,
        quat=_quaternion([math.pi / 2, 0, 0]),
    )
    # The tubes end short of the hip housing and of the foot: the sphere alone touches the ground.
    # A leg that folds next to the ground has nothing at the serial equivalent's knee: its femur
    # ends at the pod, and its ankle link is at the foot.
    folds = robot.legs_carry_propellers
    femur = robot.leg.thigh_link if folds else robot.thigh_length
    above, foot_end = robot.shin_length / 2 if folds else 0.0, 2 * robot.foot_radius
    _add_capsule(spec, thigh, f"{name}_thigh", robot.leg.hip_radius, femur, radius)
    _add_capsule(spec, shin, f"{name}_shin", above, robot.shin_length - foot_end, radius)
    foot = down * robot.shin_length
    sphere = mujoco.mjtGeom.mjGEOM_SPHERE
    _add_collision(spec, shin, f"{name}_foot", sphere, size=[robot.foot_radius, 0, 0], pos=foot)
    shin.add_site(spec.find_default(robot.name), name=f"{name}_foot", pos=foot)
    hand = "left" if robot.side[leg] > 0 else "right"
    add_look(spec, hip, f"hip_{hand}", hip_look(robot, leg))
    if robot.legs_carry_propellers:
        _add_knee_pod(spec, thigh, robot, leg)


def _add_knee_pod(spec: mujoco.MjSpec, thigh: mujoco.MjsBody, robot: Robot, leg: int) -> None:
    """Knee servo, propeller motor and propeller, fixed to the thigh at the knee."""
    name, pod, propellers = robot.legs[leg], robot.knee_pod, robot.propellers
    place = robot.knee_pod_in_thigh[leg]
    body = thigh.add_body(name=f"{name}_knee_pod", pos=place)
    _set_inertia(body, pod.mass, np.zeros(3), box_inertia(pod.mass, pod.size))
    box = mujoco.mjtGeom.mjGEOM_BOX
    _add_collision(spec, body, f"{name}_knee_pod", box, size=pod.size / 2, pos=np.zeros(3))
    outward = _quaternion(propeller_rpy(robot, leg))
    disc = robot.propeller_in_thigh[leg] - place
    _add_collision(
        spec,
        body,
        f"{name}_propeller",
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[propellers.diameter / 2, BLADE_HEIGHT / 2, 0],
        pos=disc,
        quat=outward,
    )
    site = spec.find_default(robot.name)
    body.add_site(site, name=f"{name}_propeller", pos=disc, quat=outward)
    hand = "left" if robot.side[leg] > 0 else "right"
    add_look(spec, body, f"knee_pod_{hand}", knee_pod_look(robot, leg))


def _add_motor(spec: mujoco.MjSpec, robot: Robot, joint: int) -> None:
    motor = spec.add_actuator(spec.find_default(robot.name), name=robot.joint_names[joint])
    motor.set_to_motor()
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    motor.target = robot.joint_names[joint]


def _add_collision(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    name: str,
    kind: mujoco.mjtGeom,
    size: ArrayLike,
    pos: ArrayLike,
    quat: ArrayLike = (1.0, 0.0, 0.0, 0.0),
) -> None:
    body.add_geom(
        spec.find_default("collision"), name=name, type=kind, size=size, pos=pos, quat=quat
    )


def _add_capsule(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, top: float, bottom: float, radius: float
) -> None:
    """Capsule along the link, between `top` and `bottom` [m] below the link's origin."""
    body.add_geom(
        spec.find_default("collision"),
        name=name,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, -top, 0, 0, -bottom],
        size=[radius, 0, 0],
    )


def _set_inertia(
    body: mujoco.MjsBody, mass: float, center: ArrayLike, principal_inertia: Array
) -> None:
    body.explicitinertial = True
    body.mass = mass
    body.ipos = center
    body.inertia = principal_inertia


def _quaternion(rpy: ArrayLike) -> Array:
    """MuJoCo's (w, x, y, z) of fixed-axis roll, pitch, yaw [rad] (3,), as in URDF."""
    return np.roll(from_roll_pitch_yaw(*np.asarray(rpy, dtype=float).tolist()), 1)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the robot as MJCF to standard output.")
    parser.add_argument("robot", nargs="?", default=ROBOTS[0], choices=ROBOTS)
    print(build_spec(load_robot(parser.parse_args().robot), bending=True).to_xml(), end="")

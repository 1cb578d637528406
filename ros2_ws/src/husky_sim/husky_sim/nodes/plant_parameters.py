"""Parameters of `plant` that say what world there is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node

from husky_description.gantry import GantryOptions
from husky_runtime import graph
from husky_runtime.nodes.parameters import declare, declare_mounting, declare_robot, declare_sensing
from husky_sim.gantry import RAIL
from husky_sim.ideal_sensing import IDEAL_SENSING
from husky_sim.scene import CONTACT_PRESETS, WorldOptions
from husky_sim.scene_grounds import WIDEST_LANE
from husky_sim.terrain import KINDS, TerrainOptions
from husky_sim.world import World

_TERRAIN = {
    "height": ("greatest of tiles and scenes; step, or step behind a gap [m]", 0.0, 1.0),
    "size": ("tile, facet or step, or width of a gap [m]", 0.02, 10.0),
    "length": ("of tiles, steps and scenes along x, slopes of a ramp or a ridge [m]", 0.1, 100.0),
    "approach": ("flat ground before a slope or a gap; where the lane ends [m]", 0.0, 100.0),
    "blend": ("radius of the arcs of a ramp or a ridge at foot and crest [m]", 0.0, 100.0),
    "top": ("flat top of a ramp or a ridge, flat ground behind a gap [m]", 0.0, 100.0),
    "lane": ("flat ground along x that scenes and steps leave free [m]", 0.0, WIDEST_LANE),
}
"""Parameters terrain_<attribute of `TerrainOptions`>: what they are, and their range."""


def declare_and_build_world(node: Node) -> World:
    """Declare what there is, build it, and save its scene where that is asked for.

    Raises:
        ValueError: a word or a combination that cannot be built.
        OSError: the scene cannot be saved.
    """
    what = "payload [kg], negative for what the robot's file says"
    payload = declare(node, "payload", -1.0, what, -1.0, 10.0)
    what = "of the body on the frame, 0 stiff, 10 or more; negative for what the file says [Hz]"
    frequency = declare(node, "frame_frequency", -1.0, what, -1.0, 40.0)
    scene = declare(node, "save_scene", "", "file that gets the world as MuJoCo XML")
    options = declare_world(node)
    sensing = declare_sensing(node, "VN-200 and T265")
    changes: dict[str, Any] = {} if payload < 0.0 else {"payload_mass": payload}
    changes |= {} if frequency < 0.0 else {"frame__frequency": frequency}
    changes |= IDEAL_SENSING if sensing == "ideal" else {}
    world = World(declare_robot(node, **changes, **declare_mounting(node)), options)
    what = "velocity of the air in world [m/s]; at zero the air is left out"
    world.blow(declare(node, "wind", [0.0, 0.0, 0.0], what, read_only=False))
    if scene:
        Path(scene).write_text(world.scene_xml, "utf-8")
    return world


def declare_world(node: Node) -> WorldOptions:
    """Declare what stands where; return it; raises ValueError for what cannot be built."""
    defaults = WorldOptions()
    terrain = _declare_terrain(node)
    contact = declare(node, "contact", defaults.contact, "contact preset", allowed=CONTACT_PRESETS)
    what = "friction coefficient, static and sliding [-], negative for the preset's"
    friction = declare(node, "friction", -1.0, what, -1.0, 5.0)
    what = "of a foot on a preset of T27 [N/m], negative for the preset's"
    stiffness = declare(node, "stiffness", -1.0, what, -1.0, 1e6)
    timestep = declare(node, "timestep", defaults.timestep, "physics step [s]", 1e-5, 0.002)
    body = declare(node, "body", defaults.body, "what stands in the world", allowed=graph.BODIES)
    unit = body == "unit"
    posture = "stand" if unit else defaults.keyframe
    postures = ("stand",) if unit else ("sit", "stand")
    what = "initial posture; the unit alone has stand only, its default"
    keyframe = declare(node, "keyframe", posture, what, allowed=postures)
    gantry = _declare_gantry(node)
    height = declare(node, "start_height", 0.0, "above the posture's own height [m]", 0.0, 5.0)
    what = "of the start along the ground's surface from x = 0 [m]"
    distance = declare(node, "start_distance", defaults.start_distance, what, 0.0, 200.0)
    what = "the base is held in place until /plant/hold releases it"
    held = declare(node, "start_held", defaults.start_held, what)
    return WorldOptions(
        terrain=terrain,
        contact=contact,
        friction=friction if friction > 0.0 else None,
        stiffness=stiffness if stiffness > 0.0 else None,
        timestep=timestep,
        body=body,
        keyframe=keyframe,
        gantry=gantry,
        start_height=height,
        start_distance=distance,
        start_held=held,
        seed=declare(node, "seed", defaults.seed, "of all noise", 0, 2**31 - 1),
    )


def _declare_terrain(node: Node) -> TerrainOptions:
    ground = TerrainOptions()
    kind = declare(node, "terrain", ground.kind, "kind of ground", allowed=KINDS)
    slope = declare(node, "slope_deg", 0.0, "inclination [deg]", -90.0, 90.0)
    rest = {
        name: declare(node, f"terrain_{name}", getattr(ground, name), *row)
        for name, row in _TERRAIN.items()
    }
    return TerrainOptions(kind=kind, slope=np.radians(slope), **rest)


def _declare_gantry(node: Node) -> GantryOptions | None:
    defaults = GantryOptions()
    wanted = declare(node, "gantry", False, "a gantry with two ropes over the body")
    options = GantryOptions(
        height=declare(node, "gantry_height", defaults.height, "of the beam [m]", 0.5, 10.0),
        rope=declare(node, "rope_length", defaults.rope, "of each rope [m]", 0.1, 10.0),
    )
    declare(
        node,
        "trolley_position",
        0.0,
        "where the gantry's trolley is sent along x [m]",
        -RAIL,
        RAIL,
        read_only=False,
    )
    return options if wanted else None

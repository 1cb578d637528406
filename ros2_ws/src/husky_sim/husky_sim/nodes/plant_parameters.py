"""Parameters of `plant` that say what world there is."""

from __future__ import annotations

import numpy as np
from rclpy.node import Node

from husky_description import graph
from husky_description.gantry import GantryOptions
from husky_description.nodes.parameters import declare
from husky_sim.gantry import RAIL
from husky_sim.scene import CONTACT_PRESETS, WorldOptions
from husky_sim.terrain import KINDS, TerrainOptions


def declare_world(node: Node) -> WorldOptions:
    """Declare what stands on what ground, and where; return it.

    Raises:
        ValueError: a word or a combination that cannot be built.
    """
    defaults, ground = WorldOptions(), TerrainOptions()
    friction = declare(
        node,
        "friction",
        -1.0,
        "sliding friction [-], negative for the preset's",
        lower=-1.0,
        upper=5.0,
    )
    return WorldOptions(
        terrain=TerrainOptions(
            kind=declare(node, "terrain", ground.kind, "kind of ground", allowed=KINDS),
            slope=np.radians(
                declare(node, "slope_deg", 0.0, "inclination [deg]", lower=-90.0, upper=90.0)
            ),
            height=declare(
                node, "terrain_height", ground.height, "tile or step [m]", lower=0.0, upper=1.0
            ),
            size=declare(
                node, "terrain_size", ground.size, "tile or step [m]", lower=0.02, upper=10.0
            ),
            length=declare(
                node,
                "terrain_length",
                ground.length,
                "of tiles and steps along x, of a ramp's slope [m]",
                lower=0.1,
                upper=100.0,
            ),
            approach=declare(
                node,
                "terrain_approach",
                ground.approach,
                "flat ground before a ramp [m]",
                lower=0.0,
                upper=100.0,
            ),
            blend=declare(
                node,
                "terrain_blend",
                ground.blend,
                "radius of a ramp's arcs at foot and crest [m]",
                lower=0.0,
                upper=100.0,
            ),
            top=declare(
                node,
                "terrain_top",
                ground.top,
                "flat ground at a ramp's top [m]",
                lower=0.0,
                upper=100.0,
            ),
        ),
        contact=declare(
            node, "contact", defaults.contact, "contact preset", allowed=tuple(CONTACT_PRESETS)
        ),
        friction=friction if friction > 0.0 else None,
        timestep=declare(
            node, "timestep", defaults.timestep, "physics step [s]", lower=1e-5, upper=0.002
        ),
        keyframe=declare(
            node, "keyframe", defaults.keyframe, "initial posture", allowed=("sit", "stand")
        ),
        body=declare(node, "body", defaults.body, "what stands in the world", allowed=graph.BODIES),
        gantry=_declare_gantry(node),
        start_height=declare(
            node,
            "start_height",
            0.0,
            "above the posture's own height [m]",
            lower=0.0,
            upper=5.0,
        ),
        start_distance=declare(
            node,
            "start_distance",
            defaults.start_distance,
            "of the start along the ground's surface from x = 0 [m]",
            lower=0.0,
            upper=200.0,
        ),
        start_held=declare(
            node,
            "start_held",
            defaults.start_held,
            "the base is held in place until /plant/hold releases it",
        ),
        seed=declare(node, "seed", defaults.seed, "of all noise", lower=0, upper=2**31 - 1),
    )


def _declare_gantry(node: Node) -> GantryOptions | None:
    defaults = GantryOptions()
    wanted = declare(node, "gantry", False, "a gantry with two ropes over the body")
    options = GantryOptions(
        height=declare(
            node, "gantry_height", defaults.height, "of the beam [m]", lower=0.5, upper=10.0
        ),
        rope=declare(node, "rope_length", defaults.rope, "of each rope [m]", lower=0.1, upper=10.0),
    )
    declare(
        node,
        "trolley_position",
        0.0,
        "where the gantry's trolley is sent along x [m]",
        lower=-RAIL,
        upper=RAIL,
        read_only=False,
    )
    return options if wanted else None

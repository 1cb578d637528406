"""A robot that nobody has built: lighter than Carbon, on longer legs, with six fans."""

from __future__ import annotations

from pathlib import Path

import yaml

from husky_description.share import share_path

FANS = {
    "front_left": {"x": 0.16, "y": 0.135, "spin": 1.0},
    "front_right": {"x": 0.16, "y": -0.135, "spin": -1.0},
    "middle_left": {"x": 0.02, "y": 0.17, "spin": -1.0},
    "middle_right": {"x": 0.02, "y": -0.17, "spin": 1.0},
    "hind_left": {"x": -0.14, "y": 0.135, "spin": 1.0},
    "hind_right": {"x": -0.14, "y": -0.135, "spin": -1.0},
}
"""Not symmetric fore and aft, and not in the order of the legs."""
LENGTH, MASS = 1.15, 0.86
"""Of its legs and of all of it, over Carbon's."""


def write(path: Path) -> Path:
    """Write the robot's file, which is Carbon's but for what is changed here; return its path."""
    tree = yaml.safe_load(share_path("config/carbon.yaml").read_text(encoding="utf-8"))
    tree["name"] = "husky_made_up"
    tree["total_mass"] *= MASS
    leg, posture = tree["leg"], tree["posture"]
    leg |= {"thigh_link": 0.20, "ankle_link": 0.16, "calf_link": 0.38, "hip_x": 0.22}
    posture["stand_height"] = 0.61
    tree["size"] = {"length": LENGTH, "mass": MASS}
    tree["fans"]["rotors"] = FANS
    path.write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
    return path

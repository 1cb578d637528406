"""Errors of rcl in one line: of a command line or an environment in which it makes no node."""

from __future__ import annotations

import os
import re


def said_by_rcl(error: RuntimeError) -> str:
    """Return the text of an error of rclpy in one line, without the places in the source of rcl."""
    said = re.sub(r",? at /\S+:[0-9]+", "", str(error).removeprefix("failed to initialize rcl: "))
    said = " ".join(said.removesuffix(" Error: error not set").split())
    if said == "error not set":
        security = os.environ.get("ROS_SECURITY_ENABLE")
        asked = f"; ROS_SECURITY_ENABLE={security} asks for a keystore" if security else ""
        return f"ROS does not start and gives no reason{asked}"
    return said

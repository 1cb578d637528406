"""Checks of a robot's file that involve more than one number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def check_together(read: Mapping[str, Any]) -> None:
    """Refuse sections that contradict each other or themselves.

    Raises:
        ValueError: names the dotted key and what is wrong.
    """
    pairs = (
        ("leg", "tube_inner_radius", "tube_outer_radius"),
        ("fans", "inner_radius", "outer_radius"),
        ("gear", "rated_torque", "repeated_peak_torque"),
        ("gear", "repeated_peak_torque", "momentary_peak_torque"),
        ("gear", "momentary_peak_torque", "ratcheting_torque"),
        ("drive", "continuous_current", "peak_current"),
        ("esc", "pulse_low", "pulse_start"),
    )
    for section, small, large in pairs:
        if section not in read:
            continue
        low, high = getattr(read[section], small), getattr(read[section], large)
        if low > high:
            raise ValueError(f"{section}.{small}: {low:g} is above {section}.{large}, {high:g}")
    for key in ("hip_sagittal", "knee"):
        low, high = getattr(read["joints"], key)
        if low >= high:
            raise ValueError(f"joints.{key}: lower limit {low:g} is not below upper limit {high:g}")
    inertia = read["body"].inertia
    if 2 * inertia.max() > inertia.sum():
        raise ValueError(f"body.inertia: {inertia.tolist()}: one exceeds the sum of the other two")
    read["frame"].check()
    read["d435"].check()
    if "fans" in read:
        read["fans"].check()
    if "propellers" in read:
        read["propellers"].check()
    if np.any(np.diff(read["battery"].cell_voltage) <= 0.0):
        raise ValueError("battery.cell_voltage: does not rise with the charge")

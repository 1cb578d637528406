"""What the master says about its drives, in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from husky_drivers.cia402 import DriveState, error_name
from husky_drivers.ethercat.axes import AxisSettings
from husky_drivers.ethercat.bus import AlState, Bus
from husky_drivers.ethercat.commissioning import describe_code


def describe(settings: AxisSettings, which: Any, states: Any, errors: Any) -> str:
    """Name some drives with their states and errors.

    Args:
        settings: names.
        which: (n,) bool.
        states: (n,) values of `DriveState`.
        errors: (n,) error codes.
    """
    return ", ".join(
        f"{settings.joint_names[i]}: {DriveState(int(states[i])).title}"
        + (f" ({error_name(int(errors[i]))})" if errors[i] else "")
        for i in np.flatnonzero(which)
    )


def why_incomplete(bus: Bus, settings: AxisSettings, working_counter: int) -> str:
    """Which drives miss from the exchanges."""
    away = []
    for axis, name in enumerate(settings.joint_names):
        status = bus.al_status(axis)
        if status == 0:
            away.append(f"{name} does not answer")
        elif status != AlState.OP:
            away.append(f"{name} left OP ({describe_code(bus.al_status_code(axis))})")
    counters = f"{working_counter} of {bus.expected_working_counter}"
    return f"bus incomplete, working counter {counters}: {', '.join(away) or 'frames lost'}"

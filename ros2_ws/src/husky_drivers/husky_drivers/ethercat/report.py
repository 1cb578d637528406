"""What the master says about its drives, in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from husky_drivers.cia402 import DriveState, error_name
from husky_drivers.ethercat.axes import AxisSettings
from husky_drivers.ethercat.bus import AlState, Bus


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
    for name, al in zip(settings.joint_names, bus.al_states(), strict=True):
        if al.status == 0:
            away.append(f"{name} does not answer")
        elif al.status != AlState.OP:
            away.append(f"{name} left OP ({al.reason})")
    counters = f"{working_counter} of {bus.expected_working_counter}"
    return f"bus incomplete, working counter {counters}: {', '.join(away) or 'frames lost'}"

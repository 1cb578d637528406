"""Time and electrical energy that a robot's ways of moving cost, and the file that holds them.

`scripts/experiment.sh energy` measures them; `travel_costs.csv` is its result.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TextIO

import numpy as np

from husky_description.arrays import Array

TABLE = Path(__file__).with_name("travel_costs.csv")
"""The measured costs."""
METRE, RADIAN, SECOND, ONCE = "m", "rad", "s", "once"
UNITS = (METRE, RADIAN, SECOND, ONCE)
"""Units that a cost is for: way, turn, time at one place, or a passage as a whole."""
BEYOND = 3.0
"""Slope beyond the steepest that was measured, up to which the costs of that one hold [deg]."""


@dataclass(frozen=True)
class TravelCost:
    """One measured way of moving.

    Attributes:
        robot: name of the robot.
        mode: way of moving, such as `walk`, `climb` or `fly`.
        slope_deg: inclination of the way, positive uphill [deg].
        thrust_share: share of the weight on the fans [-].
        speed: that is commanded [m/s], of a turn [rad/s]; 0 for other units.
        unit: one of `UNITS`.
        time: for one unit [s].
        energy: from the battery for one unit [J].
    """

    robot: str
    mode: str
    slope_deg: float
    thrust_share: float
    speed: float
    unit: str
    time: float
    energy: float

    def __post_init__(self) -> None:
        """Raise ValueError for a cost that cannot be: names it, and what is allowed."""
        if self.unit not in UNITS:
            raise ValueError(f"unit is {self.unit!r}, it must be {', '.join(UNITS)}")
        for name, least, most in (
            ("slope_deg", -90.0, 90.0),
            ("thrust_share", 0.0, 1.0),
            ("speed", 0.0, 10.0),
            ("time", 1e-6, 1e4),
            ("energy", 0.0, 1e7),
        ):
            value = getattr(self, name)
            if not least <= value <= most:
                raise ValueError(f"{name} is {value}, it must be {least:g} to {most:g}")


_COLUMNS = tuple(field.name for field in fields(TravelCost))


class TravelCosts:
    """The costs of one robot.

    Attributes:
        rows: in the order of the file.
    """

    def __init__(self, rows: Iterable[TravelCost]):
        """Take the costs of one robot."""
        self.rows = tuple(rows)

    @classmethod
    def load(cls, robot: str, path: Path = TABLE) -> TravelCosts:
        """Read the costs of a robot.

        Raises:
            ValueError: the file is no table of costs, or has none of that robot.
            OSError: it cannot be read.
        """
        with path.open(encoding="utf-8", newline="") as file:
            try:
                rows = read_costs(file)
            except ValueError as error:
                raise ValueError(f"{path}: {error}") from error
        chosen = [row for row in rows if row.robot == robot]
        if not chosen:
            known = ", ".join(dict.fromkeys(row.robot for row in rows)) or "none"
            raise ValueError(f"{path}: no costs of {robot!r}, there are those of {known}")
        return cls(chosen)

    def per_metre(self, mode: str, speed: float, slope_deg: Array) -> tuple[Array, Array]:
        """Return time [s] and energy [J] of a metre of way, linear between the measured slopes.

        Walks with a share of the weight on the fans do not count. A slope a little steeper than all
        that were measured costs as much as the steepest.

        Args:
            mode: way of moving.
            speed: one of those that were measured [m/s].
            slope_deg: of the way, positive uphill [deg] (n,).

        Returns:
            Two arrays (n,), NaN for slopes more than `BEYOND` beyond those that were measured.

        Raises:
            LookupError: nothing was measured in this mode at this speed.
        """
        chosen = sorted(
            (row.slope_deg, row.time, row.energy)
            for row in self.rows
            if (row.mode, row.unit, row.speed, row.thrust_share) == (mode, METRE, speed, 0.0)
        )
        if not chosen:
            raise LookupError(f"no costs of mode {mode!r} at {speed:g} m/s")
        slopes, times, energies = np.array(chosen).T
        known = (slope_deg >= slopes[0] - BEYOND) & (slope_deg <= slopes[-1] + BEYOND)
        return (
            np.where(known, np.interp(slope_deg, slopes, times), math.nan),
            np.where(known, np.interp(slope_deg, slopes, energies), math.nan),
        )

    def of(self, mode: str, unit: str) -> TravelCost:
        """Return the cost of a turn, of time at one place, or of a passage.

        Raises:
            LookupError: there is none in this mode for this unit, or several.
        """
        found = [row for row in self.rows if (row.mode, row.unit) == (mode, unit)]
        if len(found) != 1:
            raise LookupError(f"{len(found)} costs of mode {mode!r} for the unit {unit!r}, not 1")
        return found[0]


def read_costs(file: TextIO) -> list[TravelCost]:
    """Read costs from a table; lines that begin with # are comments.

    Raises:
        ValueError: the table is damaged; names the row, comments not counted.
    """
    rows, lines = [], (line for line in file if not line.startswith("#"))
    reader = csv.DictReader(lines)
    if tuple(reader.fieldnames or ()) != _COLUMNS:
        raise ValueError(f"columns are {reader.fieldnames}, they must be {', '.join(_COLUMNS)}")
    texts = ("robot", "mode", "unit")
    for number, line in enumerate(reader, 1):
        try:
            if None in line or None in line.values():
                raise ValueError(f"it must have {len(_COLUMNS)} columns")
            values = {k: v if k in texts else float(v) for k, v in line.items()}
            rows.append(TravelCost(**values))  # type: ignore[arg-type]
        except ValueError as error:
            raise ValueError(f"row {number}: {error}") from error
    return rows


def write_costs(file: TextIO, rows: Sequence[TravelCost], comment: str) -> None:
    """Write costs below lines of comment."""
    file.writelines(f"# {line}\n" for line in comment.splitlines())
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for row in rows:
        values = (getattr(row, name) for name in _COLUMNS)
        writer.writerow(v if isinstance(v, str) else f"{v:.5g}" for v in values)

"""The end of a flight that is stopped: the way to the nearest ground on which it may land."""

from __future__ import annotations

import math

from husky_navigation.following.ground_checks import air_is_blocked, may_land, nearest_landing
from husky_navigation.following.leg_follower import LegFollower, follower_of
from husky_navigation.following.robot_wish import RobotView, Wish, is_up, wish_of
from husky_navigation.planning.air_layers import AirLayers
from husky_navigation.planning.planning_grid import PlanningGrid
from husky_navigation.planning.route import Leg


class Refuge:
    """Leads a robot in the air to a place to land.

    The place is chosen once, and again where the way turns out to be blocked, or the ground there
    unfit.
    """

    def __init__(self) -> None:
        """Choose no place yet."""
        self._way: tuple[Leg, LegFollower] | None = None

    def wish(self, view: RobotView, grid: PlanningGrid, air: AirLayers) -> Wish | None:
        """Return the wish that leads the robot there; None where it comes down.

        Args:
            view: of the robot.
            grid: the ground.
            air: over it.
        """
        if self._way is None or air_is_blocked(grid, air, self._way[1], self._way[0].altitude):
            self._choose(view, grid, air)
            return None if self._way is None else wish_of(self._way[0], view)
        leg, follower = self._way
        wish, velocity = wish_of(leg, view), follower.command(view.pose)
        if velocity is not None:
            return wish._replace(velocity=velocity) if is_up(leg, view) else wish
        if may_land(grid, air, view.pose):
            return None
        self._choose(view, grid, air)
        if self._way is None or self._way[1].command(view.pose) is None:
            return None
        return wish_of(self._way[0], view)

    def _choose(self, view: RobotView, grid: PlanningGrid, air: AirLayers) -> None:
        """Choose the place, and the way there; neither if there is none."""
        may_rise = math.isfinite(view.take_off)
        leg = nearest_landing(grid, air, view.pose, view.height, may_rise=may_rise)
        self._way = None if leg is None else (leg, follower_of(leg))

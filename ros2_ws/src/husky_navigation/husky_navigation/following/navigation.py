"""One way to one or more goals: plan, change the mode for each leg, follow it, stop.

Everything happens in steps, each with what the robot has told; nothing here waits.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from husky_navigation.following.ground_checks import (
    SIGHT,
    air_is_blocked,
    can_climb_on,
    can_walk,
    ground_below,
    has_room_behind,
    is_blocked,
    is_seen,
    may_hope_to_land,
    may_land,
    needs_a_look,
    place_ahead,
)
from husky_navigation.following.leg_follower import (
    LegFollower,
    VelocityCommand,
    follower_of,
)
from husky_navigation.following.refuge import Refuge
from husky_navigation.following.robot_wish import (
    MODE_OF,
    PERCH,
    QUADROTOR,
    SPLAY,
    STAND,
    TROT,
    WAIR,
    RobotView,
    Wish,
    is_up,
    wish_of,
)
from husky_navigation.planning.air_layers import AirLayers
from husky_navigation.planning.planning_grid import PlanningGrid
from husky_navigation.planning.route import Leg, PlanePose, Refusal, Route, RouteError
from husky_navigation.planning.route_search import CLIMB, FLY, WALK, Place

_BEGINS_IN = ("stand_up", STAND, TROT, WAIR, PERCH, SPLAY, QUADROTOR)
"""Modes in which a robot can be sent somewhere."""
_CHANGING = 12.0
"""Longest time that a change of the mode takes, fans included [s]."""
_STOPPING = 4.0
"""Longest time until the robot stands; on a slope it stays in mode `wair` [s]."""
_SETTLING, _SHIFTED = 0.8, 0.1
"""Time in which a robot comes to rest on its feet [s], and distance from the goal from which on it
walks there again [m]: the base moves by up to 0.12 m when the last steps end.
"""
_IN_THE_AIR = 40.0
"""Longest time from the take-off to the height of a flight, or from there to the ground [s]."""
_PROGRESS, _PATIENCE = 0.1, 8.0
"""Way that the robot makes in a time, or it is stuck [m, s]."""
_MOST_BEGUN = 15
"""Plans and changes of the mode that it makes without that."""
_TURNED = 0.2
"""Turn that counts as progress too [rad]."""
_OLD = 2.5
"""Age from which on a map tells nothing of what stands ahead [s]; one comes each second."""
_HESITATION = 0.5
"""Time that it climbs on without seeing the ground ahead [s]."""
_LOOKING = 4.0
"""Time that it waits for ground to be seen [s]."""
_AFTER = 0.3
"""Time after the robot stands until a map counts as one that it sees from there [s]."""
_OFTEN = 5.0
"""Least time between two plans for want of energy [s]."""
_MAY_CHANGE = (Refusal.NO_WAY, Refusal.START_OCCUPIED)
"""Reasons for which there is no route that may be others when more is seen."""
_RECOVERIES, _MOST_RECOVERIES = 3, 10
"""Times that it recovers before it gives up, without a leg in between that was gone, and in all."""
_BACK, _BACK_TIME = 0.15, 2.0
"""Speed and time of a step back [m/s, s]."""
_LOOK_RATE, _LOOK_TIME = 0.4, 3.0
"""Yaw rate [rad/s], and time to the left end [s]; from there to the right end takes twice that."""
_NO_LANDING = "the ground where it was to land is seen, and is not fit for that"
"""Reason of a flight that ends over such ground."""
_LONG = 1.0
"""Length of a leg after which the way is planned anew, as more is seen by then [m]."""


class Outcome(enum.Enum):
    """Ends of a navigation."""

    REACHED = "the goal is reached"
    NO_ROUTE = "there is no route"
    STUCK = "the robot makes no progress"
    UNSEEN = "the ground ahead is not seen"
    NOT_CHANGED = "the controller does not enter the mode"
    NOT_READY = "the robot does not stand"
    STOPPED = "the robot was stopped, or has fallen"
    LOST = "the robot does not know where it is"
    CANCELLED = "cancelled"
    REPLACED = "another goal has come"


class _Phase(enum.Enum):
    PLAN = "planning"
    LOOK = "looking ahead"
    CHANGE = "changing the mode"
    FOLLOW = "following"
    RECOVER = "stepping back and looking around"
    STOP = "stopping"
    END = "ended"


Planner = Callable[[PlanePose, PlanePose, tuple[Place, ...], float | None], Route]
"""Returns the route from a pose to a goal that keeps off places which cannot be seen, of a robot
in the air from its height [m]; raises RouteError.
"""


class Navigation:
    """Leads the robot to one goal after the other.

    Attributes:
        outcome: None as long as it goes on.
        reason: of an outcome, for a person.
        refusal: of a route, where `outcome` is NO_ROUTE.
        route: to the goal that is next, None before the first.
        recoveries: that were made.
        reached: goals that were reached.
    """

    def __init__(self, goals: Sequence[PlanePose], plan: Planner) -> None:
        """Begin.

        Args:
            goals: one or more, in order.
            plan: makes the routes.
        """
        self._goals, self._plan = tuple(goals), plan
        self.outcome: Outcome | None = None
        self.reason = ""
        self.refusal: Refusal | None = None
        self.route: Route | None = None
        self.recoveries = self.reached = self._tries = self._begun = 0
        self._ending: Outcome | None = None
        self._phase = _Phase.PLAN
        self._index = 0
        self._follower: LegFollower | None = None
        self._began = self._turned_back = self._is_on_slope = False
        self._has_landed = self._has_climbed = self._comes_down = False
        self._refuge = Refuge()
        self._mode = ""
        self._air: AirLayers | None = None
        self._since = 0.0
        self._seen_at = self._moves_since = self._planned_at = 0.0
        self._looked_from: Place | None = None
        self._closed: tuple[Place, ...] = ()
        self._mark = (0.0, PlanePose(0.0, 0.0, 0.0))

    @property
    def phase(self) -> str:
        """Name of what it does, for a person."""
        return self._phase.value

    @property
    def leg(self) -> Leg | None:
        """The leg that is gone or comes next."""
        if self.route is None or self._index >= len(self.route.legs):
            return None
        return self.route.legs[self._index]

    @property
    def goals_left(self) -> int:
        """Goals that were not reached yet."""
        return len(self._goals) - self.reached

    @property
    def left(self) -> float:
        """Way that is left to the next goal [m]."""
        return self._left(lambda leg: leg.length)

    @property
    def time_left(self) -> float:
        """Time that is planned for the way that is left [s]."""
        return self._left(lambda leg: leg.time)

    @property
    def energy_left(self) -> float:
        """Energy that is planned for the way that is left [J]."""
        return self._left(lambda leg: leg.energy)

    def _left(self, amount: Callable[[Leg], float]) -> float:
        route, index, follower = self.route, self._index, self._follower  # another thread looks
        if route is None or index >= len(route.legs):
            return 0.0
        leg = route.legs[index]
        share = follower.left / leg.length if follower and leg.length > 0.0 else 1.0
        return sum(amount(each) for each in route.legs[index + 1 :]) + max(0.0, share) * amount(leg)

    def step(
        self, view: RobotView, grid: PlanningGrid, air: AirLayers | None = None
    ) -> Wish | None:
        """Return what the robot is asked for now, None: nothing, for it has ended.

        Args:
            view: of the robot.
            grid: the ground as it is known now.
            air: over it; None for a robot that does not fly.
        """
        self._air = air
        self._look_at_mode(view)
        if self.outcome is not None:
            return None
        self._is_on_slope = view.mode == WAIR and not can_walk(grid, view.pose)
        if self._phase is _Phase.PLAN:
            self._make_route(view)
        if self._phase is _Phase.LOOK:
            return self._look(view)
        if self._phase is _Phase.CHANGE:
            return self._change(view, grid)
        if self._phase is _Phase.FOLLOW:
            return self._follow(view, grid)
        if self._phase is _Phase.RECOVER:
            return self._recover(view, grid)
        return self._stand(view, grid)

    def stop(self, view: RobotView, outcome: Outcome, reason: str = "") -> None:
        """Stop the robot, then end."""
        if self.outcome is None and self._phase is not _Phase.STOP:
            self._ending, self.reason = outcome, reason or outcome.value
            self._comes_down, self._refuge = False, Refuge()
            self._enter(_Phase.STOP, view)

    def finish(self, outcome: Outcome, reason: str = "") -> None:
        """End at once."""
        if self.outcome is None:
            self.outcome, self.reason = outcome, reason or outcome.value
            self._phase = _Phase.END

    # Phases ---------------------------------------------------------------------------------------
    def _enter(self, phase: _Phase, view: RobotView) -> None:
        self._phase = phase
        self._since = self._seen_at = self._moves_since = view.time
        self._mark = view.time, view.pose

    def _waits(self, view: RobotView, most: float) -> bool:
        """Return whether the phase has lasted longer than a time [s]."""
        return view.time > self._since + most

    def _look_at_mode(self, view: RobotView) -> None:
        """End where the robot is in a mode in which it goes nowhere; each mode has its own time."""
        if view.mode != self._mode and self._phase in (_Phase.CHANGE, _Phase.STOP):
            self._since = view.time
        before, self._mode = self._mode, view.mode
        if view.mode in _BEGINS_IN:
            self._began = True
            self._look_at_flight(view, before)
        elif self._began:
            self.finish(Outcome.STOPPED, f"{Outcome.STOPPED.value}: it is in mode {view.mode}")
        else:
            begins_in = f"{', '.join(_BEGINS_IN[:-1])} or {_BEGINS_IN[-1]}"
            told = f"it is in mode {view.mode}, it must be in {begins_in}"
            self.finish(Outcome.NOT_READY, f"{Outcome.NOT_READY.value}: {told}")

    def _look_at_flight(self, view: RobotView, before: str) -> None:
        """End a flight that others or a fault have ended; land one that has lost a fan.

        Args:
            view: of the robot.
            before: mode in the last step.
        """
        if self._phase is _Phase.STOP:
            return
        is_down = before == QUADROTOR and view.mode == SPLAY
        if is_down and not view.lands:
            told = "it has landed, and was not asked to by the navigator"
            self.finish(Outcome.STOPPED, f"{Outcome.STOPPED.value}: {told}")
        elif is_down and not self._has_landed:
            self._enter(_Phase.PLAN, view)  # an earlier navigation has begun that landing
        elif view.mode == QUADROTOR and not view.has_fans and not self._has_landed:
            self.stop(view, Outcome.STOPPED, f"{Outcome.STOPPED.value}: a fan is lost in flight")

    def _make_route(self, view: RobotView) -> None:
        self._planned_at, self._turned_back = view.time, False
        while True:
            try:
                goal = self._goals[self.reached]
                altitude = view.height if view.mode == QUADROTOR else None
                self.route = self._plan(view.pose, goal, self._closed, altitude)
            except RouteError as error:
                if error.off_slope is None or not self._may_try_again():
                    self.refusal = error.refusal
                    self._give_up(view, Outcome.NO_ROUTE, str(error))
                    return
                self.route = error.off_slope
            self._index = 0
            place = self._looked_from
            if place is None or not needs_a_look(self.route, place):
                break
            if place in self._closed:
                self._give_up(view, Outcome.UNSEEN)
                return
            self._closed = (*self._closed, place)
        self._begin_leg(view)

    def _begin_leg(self, view: RobotView) -> None:
        leg = self.leg
        if leg is None and self.route is not None and not self.route.is_whole:
            self._look_at_goal(view, self.route)
            return
        if leg is None:
            self.reached += 1
            if self.reached == len(self._goals):
                self.stop(view, Outcome.REACHED)
            else:
                self.route = None
                self._enter(_Phase.PLAN, view)
            return
        can_rise = view.mode != QUADROTOR or math.isfinite(view.take_off)
        if leg.mode == FLY and not can_rise and not self._is_ready(leg, view):
            told = "it flies, and cannot rise: the navigator does not know where it took off"
            self.stop(view, Outcome.NOT_READY, f"{Outcome.NOT_READY.value}: {told}")
            return
        self._follower = follower_of(leg)
        self._enter(_Phase.LOOK if leg.mode == CLIMB and not leg.is_seen else _Phase.CHANGE, view)

    def _look_at_goal(self, view: RobotView, route: Route) -> None:
        """Plan again from beside a goal around which too little was seen; else look around."""
        if route.length > _PROGRESS:
            self._enter(_Phase.PLAN, view)
            self._begin_again(view)
        else:
            self._give_up(view, Outcome.UNSEEN)

    def _look(self, view: RobotView) -> Wish:
        """Wait for a map of what is ahead, then plan again."""
        if view.time - view.map_age > self._since + _AFTER:
            if not self._has_climbed:
                self._looked_from = view.pose[:2]
            self._has_climbed = False
            self._enter(_Phase.PLAN, view)
        elif self._waits(view, _LOOKING):
            self._give_up(view, Outcome.UNSEEN)
        if view.mode in (WAIR, QUADROTOR):
            return Wish(view.mode, fans=True)
        return Wish(TROT)

    def _change(self, view: RobotView, grid: PlanningGrid) -> Wish:
        """Wait for the mode of the leg."""
        assert self.leg is not None
        wish = wish_of(self.leg, view)
        if self._lacks_fans(self.leg, view):
            self._enter(_Phase.PLAN, view)
            self._begin_again(view)
            return Wish(TROT)
        if self._is_ready(self.leg, view):
            if self._has_landed:
                self._has_landed = False
                self._enter(_Phase.PLAN, view)
                return wish
            self._enter(_Phase.FOLLOW, view)
            return self._follow(view, grid)
        rises = view.mode == QUADROTOR and self.leg.mode == FLY
        if rises and view.time - view.map_age > self._planned_at:
            self._plan_while_rising(view)
        if self._waits(view, _IN_THE_AIR if view.mode == QUADROTOR else _CHANGING):
            self._give_up(view, Outcome.NOT_CHANGED, f"{Outcome.NOT_CHANGED.value} {wish.mode}")
        return wish

    def _plan_while_rising(self, view: RobotView) -> None:
        """Plan on a map that is newer: from higher up the tops of obstacles are seen."""
        since = self._since
        self._make_route(view)
        if self._phase is _Phase.CHANGE:
            self._since = since

    def _is_ready(self, leg: Leg, view: RobotView) -> bool:
        """Return whether the robot can begin a leg."""
        if leg.mode == FLY:
            return view.mode == QUADROTOR and is_up(leg, view)
        return view.mode == MODE_OF[leg.mode] and (view.fans_ready or leg.mode != CLIMB)

    def _lacks_fans(self, leg: Leg, view: RobotView) -> bool:
        """Return whether a robot on its legs or its perch has lost a fan that a leg needs."""
        needs_fans = leg.mode != WALK and not leg.downwards
        return needs_fans and not view.has_fans and view.mode not in (WAIR, QUADROTOR)

    def _follow(self, view: RobotView, grid: PlanningGrid) -> Wish:
        leg, follower = self.leg, self._follower
        assert leg is not None and follower is not None
        if view.mode != MODE_OF[leg.mode]:  # a silent command let it stand
            self._enter(_Phase.CHANGE, view)
            self._begin_again(view)
            return wish_of(leg, view)
        if leg.mode == CLIMB:
            return self._climb(view, grid, leg, follower)
        if leg.mode == FLY:
            return self._fly(view, grid, leg, follower)
        return self._walk(view, grid, leg, follower)

    def _walk(self, view: RobotView, grid: PlanningGrid, leg: Leg, follower: LegFollower) -> Wish:
        """Walk on, unless something stands on the way, or it is not seen."""
        velocity = follower.command(view.pose)
        if velocity is None:
            self._end_leg(view, leg)
            return Wish(TROT)
        if is_blocked(grid, follower) or self._needs_another(view):
            self._enter(_Phase.PLAN, view)
            self._begin_again(view)
            if self._planned_at == view.time or self._phase is not _Phase.PLAN:
                return Wish(TROT)
            return self.step(view, grid, self._air) or Wish(STAND)
        sees = view.map_age < _OLD and is_seen(grid, view.pose, follower.left)
        if velocity.forward > 0.0 and not sees:
            if view.time > self._seen_at + _LOOKING:
                if view.map_age < _OLD:
                    self._closed = (*self._closed, place_ahead(view.pose, SIGHT[1]))
                self._give_up(view, Outcome.UNSEEN)
            return Wish(TROT)
        self._seen_at = view.time
        if self._is_stuck(view):
            self._give_up(view, Outcome.STUCK)
            return Wish(TROT)
        return Wish(TROT, velocity=velocity)

    def _climb(self, view: RobotView, grid: PlanningGrid, leg: Leg, follower: LegFollower) -> Wish:
        """Climb on along a lane; back to where it began if a fan is lost, or nothing is seen."""
        velocity = follower.command(view.pose)
        if velocity is None:
            self._end_leg(view, leg)
            return Wish(WAIR, fans=True)
        if self._turned_back:
            if self._is_stuck(view):
                self.stop(view, Outcome.STUCK)
            return Wish(WAIR, True, velocity)
        if view.map_age < _OLD and can_climb_on(grid, leg, view.pose):
            self._seen_at = view.time
        in_vain = view.time - self._seen_at
        if in_vain > _LOOKING or not (view.has_fans or leg.downwards) or self._is_stuck(view):
            self._turn_back(leg, view)
            return Wish(WAIR, fans=True)
        return Wish(WAIR, True, velocity if in_vain < _HESITATION else VelocityCommand())

    def _fly(self, view: RobotView, grid: PlanningGrid, leg: Leg, follower: LegFollower) -> Wish:
        """Fly on; land where the ground turns out to be fit for it, else look and plan again."""
        assert self._air is not None
        leg = replace(leg, ground=ground_below(grid, self._air, leg))
        hover, velocity = wish_of(leg, view), follower.command(view.pose)
        if velocity is None:
            if may_land(grid, self._air, view.pose):
                self._end_leg(view, leg)
            else:
                x, y = leg.points[-1].tolist()
                self._closed = (*self._closed, (x, y))
                is_unseen = may_hope_to_land(grid, self._air, view.pose)
                self._give_up(view, Outcome.UNSEEN, "" if is_unseen else _NO_LANDING)
            return hover
        if air_is_blocked(grid, self._air, follower, leg.altitude) or self._needs_another(view):
            self._enter(_Phase.PLAN, view)
            self._begin_again(view)
            return hover
        if view.map_age > _OLD:  # the ground below need not be seen, new obstacles ahead must be
            if view.time > self._seen_at + _LOOKING:
                self._give_up(view, Outcome.UNSEEN)
            return hover
        self._seen_at = view.time
        if self._is_stuck(view):
            self._give_up(view, Outcome.STUCK)
            return hover
        return hover._replace(velocity=velocity)

    def _stand(self, view: RobotView, grid: PlanningGrid) -> Wish:
        """Come to rest on the legs: a robot in the air goes where it may land first."""
        assert self._ending is not None
        if view.mode == QUADROTOR and not self._comes_down:
            assert self._air is not None
            seeking = not self._waits(view, _IN_THE_AIR)
            wish = self._refuge.wish(view, grid, self._air) if seeking else None
            if wish is not None:
                return wish
            self._comes_down, self._since = True, view.time
        stands = view.mode == STAND and not view.waits
        if stands and self._ending is Outcome.REACHED and not self._rests_at_goal(view):
            return Wish(STAND)
        most = {QUADROTOR: _IN_THE_AIR, SPLAY: _CHANGING, PERCH: _CHANGING}
        if stands or self._waits(view, most.get(view.mode, _STOPPING)):
            self.finish(self._ending, self.reason)
        return Wish(STAND)

    def _rests_at_goal(self, view: RobotView) -> bool:
        """Return whether a standing robot is at rest; plan again if it has shifted too far."""
        if not self._waits(view, _SETTLING):
            return False
        goal = self._goals[-1]
        shift = math.hypot(view.pose.x - goal.x, view.pose.y - goal.y)
        if shift <= _SHIFTED or not self._may_try_again():
            return True
        self._ending, self.reason = None, ""
        self.reached -= 1
        self._enter(_Phase.PLAN, view)
        return False

    def _turn_back(self, leg: Leg, view: RobotView) -> None:
        """Lead the robot back to where a climb began, backwards."""
        if not self._may_try_again():
            self.stop(view, Outcome.STUCK)
            return
        x, y = leg.points[0]
        back = replace(leg, points=np.array((view.pose[:2], (x, y))), downwards=not leg.downwards)
        self.route, self._index, self._turned_back = Route((back,)), 0, True
        self._closed = (*self._closed, (float(x), float(y)))
        self._follower = follower_of(back)

    def _end_leg(self, view: RobotView, leg: Leg) -> None:
        """Go on with the next leg; after a long one, or a climb, more of the ground is known."""
        self._index += 1
        if leg.length > _LONG and not self._turned_back:
            self._tries = 0
        self._turned_back = False
        if leg.mode == FLY:  # it lands, then plans again
            self._has_landed = True
            self._begin_leg(view)
        elif leg.mode == CLIMB:  # the newest map was made on the slope
            self._has_climbed = True
            self._enter(_Phase.LOOK, view)
        elif self.leg is not None and leg.length > _LONG:
            self._enter(_Phase.PLAN, view)
        else:
            self._begin_leg(view)

    def _needs_another(self, view: RobotView) -> bool:
        """Return whether the battery or a lost fan forbids the rest of the route."""
        assert self.route is not None
        if not view.has_fans and any(
            leg.mode != WALK for leg in self.route.legs[self._index + 1 :]
        ):
            return True
        return self.energy_left > view.energy and view.time > self._planned_at + _OFTEN

    def _recover(self, view: RobotView, grid: PlanningGrid) -> Wish:
        """Step back, look to the left and to the right, then plan again."""
        if view.mode != TROT:
            if self._waits(view, _CHANGING):
                self.stop(view, Outcome.NOT_CHANGED, f"{Outcome.NOT_CHANGED.value} {TROT}")
            self._moves_since = view.time
            return Wish(TROT)
        since = view.time - self._moves_since
        if since < _BACK_TIME:
            has_room = has_room_behind(grid, view.pose, _BACK * _BACK_TIME)
            return Wish(TROT, velocity=VelocityCommand(-_BACK if has_room else 0.0))
        looked = since - _BACK_TIME
        if looked < 3.0 * _LOOK_TIME:
            side = 1.0 if looked < _LOOK_TIME else -1.0
            return Wish(TROT, velocity=VelocityCommand(turn=side * _LOOK_RATE))
        self._enter(_Phase.PLAN, view)
        return Wish(TROT)

    def _give_up(self, view: RobotView, outcome: Outcome, reason: str = "") -> None:
        """Recover, or stop where that was tried often enough or would not help.

        On a slope and in the air it waits for another map: it neither steps back nor turns there.
        It looks once at a goal to which a way led before, and which is occupied now.
        """
        may_change = self.refusal in _MAY_CHANGE
        may_change |= self.refusal is Refusal.GOAL_OCCUPIED and self.route is not None
        if (outcome is Outcome.NO_ROUTE and not may_change) or not self._may_try_again():
            self.stop(view, outcome, reason)
            return
        self.route = self._follower = None
        waits = self._is_on_slope or view.mode == QUADROTOR
        self._enter(_Phase.LOOK if waits else _Phase.RECOVER, view)

    def _begin_again(self, view: RobotView) -> None:
        """Count that the robot plans or changes the mode anew; too often without a way is stuck."""
        self._begun += 1
        if self._begun > _MOST_BEGUN:
            self._begun = 0
            self._give_up(view, Outcome.STUCK)

    def _may_try_again(self) -> bool:
        """Count a recovery; return whether it may be made."""
        if self._tries == _RECOVERIES or self.recoveries == _MOST_RECOVERIES:
            return False
        self._tries += 1
        self.recoveries += 1
        return True

    # Judgements -----------------------------------------------------------------------------------
    def _is_stuck(self, view: RobotView) -> bool:
        time, pose = self._mark
        moved = math.hypot(view.pose.x - pose.x, view.pose.y - pose.y)
        turned = abs(math.remainder(view.pose.yaw - pose.yaw, 2.0 * math.pi))
        if moved > _PROGRESS or turned > _TURNED:
            self._begun = 0
            self._mark = view.time, view.pose
            return False
        return view.time > time + _PATIENCE

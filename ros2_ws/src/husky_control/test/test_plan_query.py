"""When another plan is asked for while climbing, and for which slope and speed."""

import math

import pytest

from husky_control.controller import Controller
from husky_control.modes.table import Mode
from husky_control.parameters import Parameters
from husky_control.plan_query import SLOPE_STEP, PlanQuery, next_query
from husky_description.robot import load_robot


class Walker(Controller):
    """A controller that climbs at 0.25 m/s, as far as `next_query` looks."""

    mode = Mode.WAIR

    def __init__(self, mounting="vectoring", **parameters):
        robot = load_robot(fans__mounting=mounting)
        super().__init__(robot, Parameters(parameters), warm_up=False)
        self.speed = self.walking.reference.ramped
        self.speed[0] = 0.25
        self.forward = self.body.rotation[:, 0]

    def at(self, degrees):
        slope = math.radians(degrees)
        self.climbing.normal[:] = -math.sin(slope), 0.0, math.cos(slope)
        self.forward[:] = math.cos(slope), 0.0, math.sin(slope)
        return self


def test_it_asks_for_what_it_walks_on():
    query = next_query(Walker(**{"wair.load_slope": 0.4}).at(44.0), None)
    assert math.degrees(query.slope) == pytest.approx(45.0)
    assert query.speed == pytest.approx(0.25)
    assert query.load_slope == 0.4 and query.thrust_mode == "vector"
    assert next_query(Walker("fixed").at(30.0), None).thrust_mode == "body_z"


@pytest.mark.parametrize("degrees", [0.0, 4.9])
def test_on_the_flat_nothing_is_asked(degrees):
    assert next_query(Walker().at(degrees), None) is None


def test_only_in_wair_with_fans_walking_and_facing_the_slope():
    walker = Walker().at(30.0)
    walker.mode = Mode.WALK
    assert next_query(walker, None) is None
    assert next_query(Walker(**{"wair.thrust_share": 0.0}).at(30.0), None) is None
    walker = Walker().at(30.0)
    walker.speed[0] = 0.0
    assert next_query(walker, None) is None
    walker = Walker().at(30.0)
    walker.forward[:] = 0.0, 1.0, 0.0
    assert next_query(walker, None) is None


def test_a_query_holds_until_slope_or_speed_have_clearly_left_it():
    walker = Walker().at(30.0)
    first = next_query(walker, None)
    step = math.degrees(SLOPE_STEP)
    assert next_query(walker.at(30.0 + 0.69 * step), first) is None
    assert next_query(walker.at(30.0 - 0.69 * step), first) is None
    second = next_query(walker.at(30.0 + 0.75 * step), first)
    assert math.degrees(second.slope) == pytest.approx(30.0 + step)
    walker.speed[0] = -0.25
    third = next_query(walker, second)
    assert isinstance(third, PlanQuery) and third.speed == pytest.approx(-0.25)

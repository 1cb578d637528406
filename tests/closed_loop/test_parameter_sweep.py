"""Every live parameter at both ends of its range: the robot does its task, whatever it is.

An end is set while the robot is at its task, or before it begins, in turns; HUSKY_SWEEP=4 takes
each both ways, and four times as long; HUSKY_SWEEP_SEED=3 is another robot.
The first end of a task that no quicker test in one process does is not slow: a trot with the fans'
help, a climb with fixed fans, treading. `test_walking` has the trot.
"""

import math
import os

import pytest
from climbing_robot import ClimbingRobot
from flying import FlyingRobot
from in_process import InProcessRobot
from swept_robot import LONGER, SPEED, SweptRobot, at_end, cases, ends

from husky_control.parameters import TABLE
from husky_sim.world import WorldOptions

END = ("name", "end")
DURATION = {"trot": 0.7, "bound": 0.9, "pronk": 0.9, "crawl": 2.7, "climb": 0.7, "lean": 1.4}
"""Of a walk with one value [s]; with fixed fans the way of one step says little."""
SEED = int(os.environ.get("HUSKY_SWEEP_SEED", "11"))
"""Of the sensors' noise: the robots of another seed walk another way."""
GAINS = ("command.", "walk.", "foothold.", "contact.", "estimator.", "safety.")
CRAWLING = ("walk.sway_", "walk.static_", "walk.load_compliance")
"""Gains that act in a gait with a static margin."""
FLAT = ("gait.trot.", "gait.bound.", "gait.pronk.")
TREADING = ("gait.trot.period", "gait.trot.duty", "gait.trot.swing_height")
SLOPE = math.radians(25.0)


def standing():
    robot = InProcessRobot(WorldOptions(seed=SEED))
    robot.stand()
    return robot


def assisted():
    robot = FlyingRobot(seed=SEED)
    robot.stand()
    robot.arm()
    return robot


def climbing(slope=SLOPE, **options):
    """A robot that climbs; it has the slope below its feet."""
    robot = ClimbingRobot(math.degrees(slope), seed=SEED, **options)
    robot.start()
    for _ in range(100):
        if (robot.world.base_position @ robot.uphill) - 0.5 * math.cos(slope) > 1.2:
            break
        robot.run(0.1, (SPEED["climb"], 0.0, 0.0))
    assert robot.controller.mode.value == "wair", robot.controller.reason
    return robot


def hanging():
    """A robot that hangs with its legs in their posture."""
    robot = InProcessRobot(WorldOptions(seed=SEED, start_height=0.6, start_held=True))
    robot.enable()
    assert robot.controller.request_mode("hang")[0]
    robot.run(4.0)
    return robot


@pytest.fixture(scope="module")
def walker():
    return SweptRobot(standing)


@pytest.fixture(scope="module")
def crawler():
    """In short cycles, which are walked whole: else the feet stand further apart each time."""
    return SweptRobot(standing, base={"gait.crawl.period": 3.0})


@pytest.fixture(scope="module")
def standing_walker():
    """For tests in a copy: how a gait does hangs on how the one before has stopped."""
    walker = SweptRobot(standing)
    walker.be_standing()
    return walker


@pytest.fixture(scope="module")
def standing_crawler():
    crawler = SweptRobot(standing, base={"gait.crawl.period": 3.0})
    crawler.be_standing()
    return crawler


@pytest.fixture(scope="module")
def helped():
    return SweptRobot(assisted, base={"assist.share": 0.4})


@pytest.fixture(scope="module")
def climber():
    up = (-math.sin(SLOPE), 0.0, math.cos(SLOPE))
    return SweptRobot(climbing, up=up)


@pytest.fixture(scope="module")
def leaner():
    """With fixed fans, on a slope on which its body leans ahead."""
    slope = math.radians(20.0)
    up = (-math.sin(slope), 0.0, math.cos(slope))
    return SweptRobot(
        lambda: climbing(slope, mounting="fixed", blend=3.0),
        base={"wair.load_slope": 0.22},
        up=up,
        falling=1.1,
    )


@pytest.fixture(scope="module")
def treader():
    return SweptRobot(hanging)


def while_walking(end):
    """Whether a value is set while the robot walks, or before; one after the other, or both."""
    return (True, False) if LONGER > 1.0 else (end == "lower",)


def sweep_walk(robot, gait, name, end):
    """Walk with a value that is set on the way, then stop with it; or set before the first step."""
    with robot.healthy():
        for live in while_walking(end):
            if live:
                robot.be_walking(gait)
            else:
                robot.be_standing()
            robot.set(at_end(name, end))
            robot.be_walking(gait)
            robot.walk(gait, LONGER * DURATION[gait])
            if live:
                robot.be_standing()


@pytest.mark.parametrize(END, cases(*GAINS, but=CRAWLING))
def test_trot(walker, name, end):
    """A gain of walking: the robot trots on, turns, keeps its speed, and stands."""
    sweep_walk(walker, "trot", name, end)


@pytest.mark.parametrize(END, cases(*CRAWLING))
def test_crawl(crawler, name, end):
    """A gain of the static margin, which only a crawl has."""
    sweep_walk(crawler, "crawl", name, end)


def sweep_gait(robot, gait, values):
    """Walk with columns of a gait, which are taken over when walking starts, and stop."""
    robot.set(values)
    robot.be_walking(gait)
    robot.walk(gait, max(robot.cycle(gait) - 0.4, LONGER * DURATION[gait]))
    robot.be_standing()


@pytest.mark.in_a_copy
@pytest.mark.parametrize(END, cases(*FLAT))
def test_gait(standing_walker, name, end):
    """A column of a gait: from standing a whole cycle at least, and back."""
    sweep_gait(standing_walker, name.split(".")[1], at_end(name, end))


@pytest.mark.in_a_copy
@pytest.mark.parametrize(END, cases("gait.crawl."))
def test_gait_that_crawls(standing_crawler, name, end):
    """The same of the crawl, whose cycle is ten times as long."""
    sweep_gait(standing_crawler, "crawl", at_end(name, end))


CORNERS = [
    {"gait.trot.period": 0.25, "gait.trot.duty": 0.53},
    {"gait.trot.period": 0.28, "gait.trot.swing_height": 0.115},
    {"gait.trot.forward_spread": -0.03, "gait.trot.lateral_spread": -0.04},
    {"gait.trot.period": 0.42, "gait.trot.duty": 0.41},
    {"gait.trot.period": 0.42, "gait.trot.duty": 0.65},
    {"gait.bound.period": 0.28, "gait.bound.duty": 0.63},
    {"gait.bound.period": 0.31, "gait.bound.duty": 0.55},
    {"gait.pronk.hop_speed": 0.5, "gait.pronk.duty": 0.69},
    {"gait.pronk.hop_speed": 0.7, "gait.pronk.duty": 0.70},
    {"gait.pronk.hop_speed": 0.7, "gait.pronk.period": 0.45},
]
"""Swings as short, as long and as high as they may be, hops that fit them barely."""


@pytest.mark.slow
@pytest.mark.in_a_copy
@pytest.mark.parametrize("values", CORNERS, ids=str)
def test_corner(standing_walker, values):
    """Values that the rules of pairs just allow."""
    sweep_gait(standing_walker, next(iter(values)).split(".")[1], values)


@pytest.mark.parametrize(END, cases("stand."))
def test_standing_up_and_sitting_down(walker, name, end):
    with walker.healthy():
        if end == "lower" or LONGER > 1.0:
            walker.be_sitting()
            walker.set(at_end(name, end))
            walker.be_standing()
        if end == "upper" or LONGER > 1.0:
            walker.be_standing()
            walker.set(at_end(name, end))
            walker.be_sitting()


@pytest.mark.parametrize(END, cases("assist.", one_by_default=True))
def test_trot_with_the_fans_help(helped, name, end):
    """What shares the weight between legs and fans."""
    sweep_walk(helped, "trot", name, end)


def sweep_climb(robot, name, end, gait="climb"):
    """Climb up with the lower end and down with the upper one."""
    up = 1.0 if end == "lower" else -1.0
    with robot.healthy():
        robot.be_stepping()
        robot.set(at_end(name, end))
        robot.climb(LONGER * DURATION[gait], up)
        if LONGER > 1.0:
            robot.be_still()
            robot.climb(LONGER * DURATION[gait], -up)


@pytest.mark.parametrize(END, cases("wair.", but=("wair.crouch_time",)))
def test_climb(climber, name, end):
    """On a slope of 25 degrees."""
    sweep_climb(climber, name, end)


@pytest.mark.parametrize(END, cases("gait.climb."))
def test_gait_that_climbs(climber, name, end):
    """Taken over with the first step on the slope."""
    with climber.healthy():
        climber.be_still()
        climber.set(at_end(name, end))
        climber.climb(LONGER * DURATION["climb"], 1.0 if end == "lower" else -1.0)
        climber.be_still()


@pytest.mark.parametrize(END, cases("wair.crouch_time"))
def test_crouch(climber, name, end):
    """The fans are lost on the slope: it ends low on its feet, where a drive may stop."""
    with climber.healthy():
        climber.be_stepping()
        climber.set({"wair.most_load_slope": 0.4, **at_end(name, end)})
        robot, most = climber.robot, 0.0
        robot.fans = False
        for _ in range(30):
            robot.run(0.1)
            most = max(most, robot.lean)
        assert robot.controller.mode.value in ("sit", "damping"), robot.controller.reason
        assert math.degrees(most) < 75.0
        climber.drop()


@pytest.mark.parametrize(END, cases("wair.lean_", one_by_default=True))
def test_climb_with_fixed_fans(leaner, name, end):
    sweep_climb(leaner, name, end, "lean")


@pytest.mark.parametrize(END, cases(*TREADING, one_by_default=True))
def test_tread(treader, name, end):
    """What a hanging robot takes of its gait."""
    with treader.healthy():
        treader.set(at_end(name, end))
        treader.ask("tread")
        treader.go(LONGER * 1.0, None, "tread")
        treader.ask("hang")
        treader.go(2.0, None, "tread", "hang", until=lambda: treader.mode == "hang")


def test_every_live_parameter_is_swept():
    swept = ends(*GAINS, "gait.", "stand.", "assist.", "wair.")
    assert {name for name, _ in swept} == {n for n, row in TABLE.items() if row.lower < row.upper}

import json
from types import SimpleNamespace

import pytest

from husky_bringup.processes import Strangers
from husky_bringup.system import NodeSpec
from husky_experiments import scenario
from husky_experiments.session import SessionError


class Robot:
    """A session that does what it is told, or not."""

    def __init__(self, speed=0.3, height=0.55):
        self.calls = []
        self.state = SimpleNamespace(mode="sit")
        self._velocity = 0.0
        self._speed = speed
        position = SimpleNamespace(x=0.0, y=0.0, z=height)
        upright = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        pose = SimpleNamespace(position=position, orientation=upright)
        self.truth = SimpleNamespace(pose=SimpleNamespace(pose=pose))

    def enable_drives(self):
        self.calls.append("enable")

    def set_gait(self, gait):
        self.calls.append(gait)

    def set_mode(self, mode, reached=None, within=0.0, patience=0.0):
        self.calls.append(mode)
        self.state.mode = reached or mode

    def set_velocity(self, vx, vy=0.0, yaw_rate=0.0):
        self._velocity = vx

    def release_velocity(self):
        self._velocity = 0.0

    def advance(self, duration):
        self.truth.pose.pose.position.x += min(self._velocity, self._speed) * duration


def test_stand():
    robot = Robot()
    scenario.stand(robot)
    assert robot.calls == ["enable", "stand_up"]
    scenario.stand(robot)
    assert robot.calls == ["enable", "stand_up"], "a robot that stands is left alone"


def test_trot():
    robot = Robot()
    scenario.trot(robot)
    assert robot.calls == ["enable", "stand_up", "trot", "walk", "stand"]


def test_a_robot_that_stays_behind_or_falls_has_not_trotted():
    with pytest.raises(SessionError, match=r"trotted 0\.50 m, less than 1\.20 m"):
        scenario.trot(Robot(speed=0.1))
    with pytest.raises(SessionError, match="fallen"):
        scenario.trot(Robot(height=0.1))


def test_the_place_of_a_robot_that_nobody_sees():
    robot = Robot()
    robot.truth = None
    with pytest.raises(SessionError, match="nobody tells"):
        scenario.trot(robot)


def test_none_does_nothing(capsys):
    assert scenario.main(["none"]) == 0
    assert json.loads(capsys.readouterr().out) == {"scenario": "none", "ok": True}


def test_a_failure_is_told(capsys, monkeypatch):
    def fail(options, output):
        raise SessionError("no robot")

    monkeypatch.setattr(scenario, "play", fail)
    assert scenario.main(["stand"]) == 1
    assert json.loads(capsys.readouterr().out)["error"] == "no robot"


def test_nodes_of_somebody_else_are_not_touched():
    nodes = Strangers()
    spec = NodeSpec("husky_sim", "plant")
    nodes.start_all([spec])
    assert nodes.start(spec) is None
    assert nodes.running("plant") and nodes.ended() == {} and nodes.end() == {}
    with pytest.raises(PermissionError, match="plant"):
        nodes.kill("plant")
    with pytest.raises(PermissionError, match="plant"):
        nodes.reap("plant")

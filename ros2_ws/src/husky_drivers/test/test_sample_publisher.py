"""Samples that nobody may have heard are published again."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from husky_drivers.nodes import sample_publisher
from husky_drivers.nodes.sample_publisher import SamplePublisher


class FakeNode:
    """A driver in a simulation, with what it has published; `look` is its timer."""

    def __init__(self):
        self.published = []
        self.publisher = SimpleNamespace(publish=self.published.append, is_activated=True)
        self.look = None

    def create_lifecycle_publisher(self, kind, topic, profile):
        return self.publisher

    def create_timer(self, period, callback):
        self.look = callback

    def get_parameter(self, name):
        return SimpleNamespace(value=True)


def make(simulated=True):
    node = FakeNode()
    return node, SamplePublisher(node, object, "imu/data", simulated=simulated)


def test_the_newest_of_the_first_samples_is_repeated_until_the_next_ones():
    node, samples = make()
    node.look()
    assert node.published == []
    for number in range(4):
        samples.publish(b"%d" % number)
        node.look()
        node.look()
    samples.publish(b"4")
    node.look()
    node.look()
    assert node.published == [b"0", b"0", b"1", b"1", b"2", b"2", b"3", b"3", b"4"]


def test_samples_that_follow_one_another_are_not_repeated():
    node, samples = make()
    for number in range(4):
        samples.publish(b"%d" % number)
        node.look()
    assert node.published == [b"0", b"1", b"2", b"3"]


def test_repeats_of_the_first_samples_end():
    node, samples = make()
    samples.publish(b"0")
    for _ in range(1000):
        node.look()
    assert len(node.published) == 1 + 299  # none at the first look


def test_an_inactive_driver_repeats_nothing():
    node, samples = make()
    samples.publish(b"0")
    node.publisher.is_activated = False
    node.look()
    node.look()
    assert node.published == [b"0"]


def test_after_a_stop_the_last_sample_is_repeated(monkeypatch):
    node, samples = make()
    now = 10.0
    monkeypatch.setattr(sample_publisher.time, "monotonic", lambda: now)
    for number in range(10):
        samples.publish(b"%d" % number)
        node.look()
        now += 0.1
    node.published.clear()
    now += 1.0
    for _ in range(50):
        node.look()
    assert node.published == [b"9"] * 20


def test_on_the_robot_nothing_is_repeated():
    node, _ = make(simulated=False)
    assert node.look is None

"""A recording gives back the run that was recorded."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_bringup.bag import BagWriter
from husky_experiments.recordings.recording import MissingTopicError, Recording
from husky_experiments.recordings.tables import Base, Table, to_rpy
from husky_runtime import graph


@pytest.fixture(scope="module")
def recording(walk_bag: Path) -> Recording:
    return Recording(walk_bag)


def test_times_and_counts(recording: Recording, walk: Any) -> None:
    assert (recording.start, recording.end) == (0.0, walk.duration)
    assert recording.counts[graph.absolute(graph.JOINT_STATES)] == 1501
    assert recording.counts[graph.absolute(graph.GROUND_TRUTH)] == 301
    assert np.allclose(np.diff(recording.joints.time), graph.TICK_PERIOD)


def test_a_robot_in_a_namespace_is_read_alike(
    tmp_path: Path, profiles: Any, typestore: Any, messages: Any
) -> None:
    """Of two robots the one whose name is shorter."""
    rows = [
        dataclasses.replace(graph.topic(name), relative=graph.absolute(name, namespace))
        for namespace in ("/robot1", "/fleet/robot2")
        for name in (graph.JOINT_STATES, graph.CLOCK)
    ]
    writer = BagWriter(tmp_path / "bag", rows, profiles, typestore)
    for channel, count in zip(writer.channels[::2], (3, 5), strict=True):
        for tick in range(count):
            zeros = [0.0] * 12
            writer.write(channel, messages.joint_states(tick * 2_000_000, zeros, zeros, zeros))
    writer.close()
    recording = Recording(tmp_path / "bag")
    assert recording.has(graph.JOINT_STATES) and not recording.has(graph.CLOCK)
    assert len(recording.joints) == 3
    assert recording.has("/fleet/robot2/joint_states")
    assert len(recording.stamps([graph.JOINT_STATES])[graph.JOINT_STATES]) == 3


def test_joints(recording: Recording, walk: Any) -> None:
    joints, commands = recording.joints, recording.commands
    assert joints.position.shape == joints.torque.shape == (1501, 12)
    assert np.allclose(joints.position[750], walk.joint_position(1.5))
    assert np.allclose(np.abs(joints.torque), np.tile(walk.torque, 4))
    assert set(commands.mode_of_operation) == {8}
    target = walk.joint_position(1.502) + walk.tracking_error
    assert np.allclose(commands.position[750], target)


def test_velocity_is_turned_to_world(recording: Recording, walk: Any) -> None:
    base = recording.base
    walking = base.time > walk.walking_from
    expected = walk.speed * np.array([np.cos(walk.yaw), np.sin(walk.yaw), 0.0])
    assert np.allclose(base.velocity[walking], expected)
    assert np.allclose(base.rpy[:, 2], walk.yaw)
    assert np.allclose(base.rpy[:, 1], walk.pitch)


def test_contacts_and_controller(recording: Recording, walk: Any) -> None:
    contacts, states = recording.contacts, recording.controller
    assert contacts.force.shape == contacts.position.shape == (301, 4, 3)
    assert np.array_equal(contacts.contact[0], [True] * 4)
    assert np.allclose(contacts.force[0], [[walk.tangential_force, 0.0, walk.normal_force]] * 4)
    assert list(dict.fromkeys(states.mode)) == ["stand", "walk"]
    assert set(states.gait) == {"trot"}
    assert states.stance.dtype == np.bool_


def test_a_topic_without_messages_is_named(recording: Recording) -> None:
    assert not recording.has(graph.IMU)
    with pytest.raises(MissingTopicError, match=graph.IMU):
        recording.columns(graph.IMU)
    with pytest.raises(MissingTopicError, match="/nonsense"):
        recording.columns("/nonsense")


def test_there_must_be_a_bag(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Recording(tmp_path / "nothing")


def test_between_keeps_both_ends() -> None:
    table = Table(np.arange(10.0))
    assert table.between(2.0, 4.0).time.tolist() == [2.0, 3.0, 4.0]
    assert len(table.between(4.5, 4.6)) == 0


def test_between_cuts_every_column(recording: Recording) -> None:
    cut = recording.base.between(1.0, 2.0)
    assert isinstance(cut, Base)
    assert len(cut) == len(cut.position) == len(cut.orientation) == 101


def test_yaw_is_unwrapped() -> None:
    yaw = np.linspace(0.0, 12.0, 200)
    turns = Rotation.from_euler("ZYX", np.column_stack((yaw, 0.1 + 0 * yaw, -0.2 + 0 * yaw)))
    rpy = to_rpy(turns.as_quat())
    assert np.allclose(rpy, np.column_stack((-0.2 + 0 * yaw, 0.1 + 0 * yaw, yaw)))

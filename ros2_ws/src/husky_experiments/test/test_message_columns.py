"""Columns hold what rosbags' own deserialiser reads, message by message."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from husky_experiments.recordings.message_columns import decode

FINITE = st.floats(allow_nan=False, width=64)


def test_joint_states(messages: Any, typestore: Any) -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(50, 3, 12))
    raw = [messages.joint_states(i * 2_000_000, *values[i]) for i in range(50)]
    columns = decode(raw, typestore, "sensor_msgs/msg/JointState")
    assert np.array_equal(columns["position"], values[:, 0])
    assert np.array_equal(columns["velocity"], values[:, 1])
    assert np.array_equal(columns["effort"], values[:, 2])
    stamps = columns["header.stamp.sec"] * 10**9 + columns["header.stamp.nanosec"]
    assert np.array_equal(stamps, np.arange(50) * 2_000_000)
    assert set(columns["name[11]"]) == {"hind_right_knee"}


def test_vectors_get_an_axis(messages: Any, typestore: Any) -> None:
    force, place = np.arange(12.0).reshape(4, 3), -np.arange(12.0).reshape(4, 3)
    raw = [messages.foot_contacts(0, (True, False, False, True), force, place)] * 3
    columns = decode(raw, typestore, "husky_msgs/msg/FootContacts")
    assert columns["force"].shape == (3, 4, 3)
    assert np.array_equal(columns["force"][2], force)
    assert np.array_equal(columns["position"][0], place)
    assert columns["contact"].dtype == np.bool_
    assert columns["contact"][1].tolist() == [True, False, False, True]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.text(alphabet="abcdé ", max_size=9),
            st.text(alphabet="xyz_", max_size=9),
            st.lists(FINITE, min_size=3, max_size=3),
            st.lists(st.booleans(), min_size=4, max_size=4),
        ),
        min_size=1,
        max_size=12,
    )
)
def test_strings_of_any_length_shift_what_follows(
    messages: Any, typestore: Any, rows: list[Any]
) -> None:
    raw = [
        messages.controller_state(
            i, mode, reason=reason, velocity=np.array(velocity), stance=np.array(stance)
        )
        for i, (mode, reason, velocity, stance) in enumerate(rows)
    ]
    columns = decode(raw, typestore, "husky_msgs/msg/ControllerState")
    for i, message in enumerate(raw):
        expected = typestore.deserialize_cdr(message, "husky_msgs/msg/ControllerState")
        assert columns["mode"][i] == expected.mode
        assert columns["reason"][i] == expected.reason
        assert np.array_equal(columns["velocity"][i], expected.velocity)
        assert np.array_equal(columns["stance"][i], expected.stance)
        assert columns["stamp.nanosec"][i] == i


def test_sequences_of_messages_are_numbered(messages: Any, typestore: Any) -> None:
    kind = typestore.types["husky_msgs/msg/DriveStatus"]
    drives = [
        kind(f"joint_{i}", 0x1237, "operation enabled", i, "none", 8, False, 22.2, 0.1 * i, 0.0)
        for i in range(12)
    ]
    raw = messages.pack(
        "husky_msgs/msg/DriveStatusArray",
        stamp=messages.stamp(5),
        operational=True,
        emergency_stop=False,
        working_counter=36,
        expected_working_counter=36,
        short_cycles=0,
        refused_commands=0,
        reason="",
        drives=drives,
    )
    columns = decode([raw], typestore, "husky_msgs/msg/DriveStatusArray")
    assert columns["drives[11].current"][0] == pytest.approx(1.1)
    assert columns["drives[7].error_code"][0] == 7
    assert columns["drives[0].state"][0] == "operation enabled"
    assert columns["operational"][0]


def test_big_endian(typestore: Any) -> None:
    kind = "geometry_msgs/msg/Vector3"
    raw = typestore.serialize_cdr(typestore.types[kind](1.0, -2.0, 3.5), kind, little_endian=False)
    columns = decode([bytes(raw)], typestore, kind)
    assert [columns[axis][0] for axis in "xyz"] == [1.0, -2.0, 3.5]


def test_sequences_of_unequal_length_have_no_columns(messages: Any, typestore: Any) -> None:
    raw = [
        messages.joint_states(0, np.zeros(12), np.zeros(12), np.zeros(12)),
        messages.joint_states(0, np.zeros(11), np.zeros(12), np.zeros(12)),
    ]
    with pytest.raises(ValueError, match="position"):
        decode(raw, typestore, "sensor_msgs/msg/JointState")

"""Process data against bytes written by hand from the slave's mapping objects."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_drivers.ethercat import pdo

INT32 = st.integers(-(2**31), 2**31 - 1)
INT16 = st.integers(-(2**15), 2**15 - 1)


def test_sizes_are_those_of_a_slave_dump():
    assert pdo.RX.itemsize * 8 == 144
    assert pdo.TX.itemsize * 8 == 176


def test_outputs_byte_by_byte():
    image = pdo.ProcessImage(pdo.RX, 2)
    row = image.fields[1]
    row["target_position"] = -2
    row["target_velocity"] = 0x01020304
    row["target_torque"] = -1000
    row["max_torque"] = 0x0AAA
    row["controlword"] = 0x000F
    row["mode_of_operation"] = 8
    row["torque_offset"] = 300
    assert image.data.hex(" ") == " ".join(
        ["00"] * 18 + ["fe ff ff ff", "04 03 02 01", "18 fc", "aa 0a", "0f 00", "08", "00", "2c 01"]
    )


def test_inputs_byte_by_byte():
    data = bytes.fromhex("e6 1e 00 00  08 00 00 00  d6 ff ff ff  33 02  eb ff  07 00  e6 bb 00 00")
    image = pdo.ProcessImage(pdo.TX, 1)
    image.load(data)
    row = image.fields[0]
    # position, inputs, statusword, analog input and voltage as in a Gold Twitter's dump
    assert row["position"] == 7910
    assert row["digital_inputs"] == 8
    assert row["velocity"] == -42
    assert row["statusword"] == 0x0233
    assert row["analog_input"] == -21
    assert row["current"] == 7
    assert row["bus_voltage"] == 48102


def test_unknown_mapping_object():
    with pytest.raises(KeyError):
        pdo.layout([0x1605, 0x16FF])


@given(st.lists(INT32, min_size=12, max_size=12))
def test_positions_round_trip(values):
    image = pdo.ProcessImage(pdo.RX, 12)
    field = pdo.Field(image, "target_position")
    field.write(np.array(values, dtype=float))
    assert np.frombuffer(bytes(image.data), pdo.RX)["target_position"].tolist() == values
    assert field.read(1.0, np.zeros(12)).tolist() == values


@given(st.lists(INT16, min_size=3, max_size=3), st.floats(-0.49, 0.49))
def test_numbers_are_rounded_to_the_nearest(values, off):
    field = pdo.Field(pdo.ProcessImage(pdo.RX, 3), "torque_offset")
    inside = [v for v in values if abs(v) < 2**15 - 1] or [0]
    wanted = np.resize(inside, 3)
    field.write(wanted + off)
    assert field.raw.tolist() == wanted.tolist()


@given(
    st.sampled_from([np.nan, np.inf, -np.inf, 1e300, 32768.0, -32769.0]),
    st.integers(0, 11),
)
def test_what_does_not_fit_is_refused_whole(bad, where):
    image = pdo.ProcessImage(pdo.RX, 12)
    field = pdo.Field(image, "target_torque")
    field.write(np.full(12, 7.0))
    before = bytes(image.data)
    values = np.full(12, 9.0)
    values[where] = bad
    with pytest.raises(ValueError, match="target_torque"):
        field.write(values)
    assert bytes(image.data) == before


def test_fields_touch_only_their_own_bytes():
    image = pdo.ProcessImage(pdo.RX, 12)
    pdo.Field(image, "target_velocity").write(np.full(12, -1.0))
    rows = np.frombuffer(bytes(image.data), np.uint8).reshape(12, 18)
    assert (rows[:, 4:8] == 0xFF).all()
    assert not rows[:, :4].any()
    assert not rows[:, 8:].any()


@pytest.mark.parametrize("length", [0, 12 * 22 - 1, 12 * 22 + 1])
def test_image_of_the_wrong_length(length):
    image = pdo.ProcessImage(pdo.TX, 12)
    with pytest.raises(ValueError, match="264"):
        image.load(bytes(length))


@pytest.mark.parametrize(
    ("kind", "assignment"), [(pdo.RX, pdo.RX_ASSIGNMENT), (pdo.TX, pdo.TX_ASSIGNMENT)]
)
def test_documentation_shows_this_layout(kind, assignment):
    documentation = Path(__file__).parents[4] / "docs" / "drives.md"
    rows = [
        f"| {kind.fields[entry.name][1]} | {address(entry)} | {entry.type[1:]} | {entry.name} |"
        for index in assignment
        for entry in pdo.MAPPINGS[index]
    ]
    assert "\n".join(rows) in documentation.read_text(encoding="utf-8")


def address(entry):
    return f"0x{entry.index:04X}:{entry.subindex}" if entry.index else "-"

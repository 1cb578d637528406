"""Parameters that outlast the process: what is written, what is read of a damaged file."""

import json

import pytest

from husky_pu.autopilot.flight_parameters import FlightParameters, ParameterError
from husky_pu.autopilot.parameter_file import ParameterFile
from husky_runtime.stored_file import read_sealed, write_sealed


def written(path, values):
    memory = ParameterFile(path)
    memory.keep(values)
    memory.close()
    return path


def test_what_is_kept_is_there_the_next_time(tmp_path):
    path = tmp_path / "deeper" / "pixhawk.parameters"
    memory = ParameterFile(path)
    assert (memory.values, memory.warning) == ({}, "")
    for value in range(50):
        memory.keep({"COM_OF_LOSS_T": value / 4, "NAV_RCL_ACT": 5})
    memory.close()
    assert memory.problem == ""
    again = ParameterFile(path)
    assert again.values == {"COM_OF_LOSS_T": 12.25, "NAV_RCL_ACT": 5}
    again.close()
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_every_byte_of_the_file_counts(tmp_path):
    path = written(tmp_path / "parameters", {"COM_OF_LOSS_T": 0.5})
    whole = path.read_bytes()
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x10
        for content in (bytes(damaged), whole[:place]):
            path.write_bytes(content)
            memory = ParameterFile(path)
            memory.close()
            assert memory.values == {}
            assert "parameters" in memory.warning
            assert path.with_name("parameters.damaged").read_bytes() == content
            assert not path.exists()


@pytest.mark.parametrize("content", [b"", b"[1]", b'{"A": "1"}', b'{"A": true}', b"{"])
def test_a_sealed_file_of_something_else(tmp_path, content):
    path = tmp_path / "parameters"
    write_sealed(path, content)
    memory = ParameterFile(path)
    memory.close()
    assert memory.values == {}
    assert "holds no parameters" in memory.warning


def test_a_disk_that_takes_nothing_is_told_once(tmp_path):
    path = tmp_path / "here" / "parameters"
    memory = ParameterFile(path)
    path.parent.rmdir()
    memory.keep({"COM_OF_LOSS_T": 0.5})
    memory.close()
    assert str(path) in memory.problem
    assert memory.problem in memory.news()
    assert memory.news() == ""


def test_a_file_that_cannot_be_read_is_an_error(tmp_path):
    with pytest.raises(OSError):
        ParameterFile(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(OSError):
        ParameterFile(tmp_path / "file" / "parameters")


def test_what_stands_above_what():
    kept = {"COM_OF_LOSS_T": 0.5, "BAT1_N_CELLS": 4, "NO_SUCH": 1.0, "FD_FAIL_R": 1000.0}
    parameters = FlightParameters({"BAT1_N_CELLS": 5}, kept, {"COM_OF_LOSS_T": 0.75})
    assert parameters.defaults["BAT1_N_CELLS"] == 5
    assert parameters["BAT1_N_CELLS"] == 4  # set by hand
    assert parameters["COM_OF_LOSS_T"] == 0.75  # of the command line
    assert parameters.kept == {"COM_OF_LOSS_T": 0.5, "BAT1_N_CELLS": 4}
    assert parameters.unfit == ["NO_SUCH: no such parameter", "FD_FAIL_R: must be 0 to 180"]
    parameters.keep("COM_OF_LOSS_T", 2.0)
    assert (parameters["COM_OF_LOSS_T"], parameters.kept["COM_OF_LOSS_T"]) == (2.0, 2.0)
    count = parameters.keepings
    with pytest.raises(ParameterError):
        parameters.keep("COM_OF_LOSS_T", 61.0)
    assert parameters.keepings == count
    parameters.forget()
    assert parameters.kept == {} and parameters["BAT1_N_CELLS"] == 5
    assert parameters["COM_OF_LOSS_T"] == 0.75


def test_the_file_can_be_read_by_eye(tmp_path):
    path = written(tmp_path / "parameters", {"NAV_RCL_ACT": 5, "COM_OF_LOSS_T": 0.5})
    assert json.loads(read_sealed(path)) == {"COM_OF_LOSS_T": 0.5, "NAV_RCL_ACT": 5}

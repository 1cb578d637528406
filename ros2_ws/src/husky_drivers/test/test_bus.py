"""Finding a bus by name."""

from importlib.metadata import EntryPoint

import pytest

from husky_drivers.ethercat import bus


@pytest.fixture
def registered(monkeypatch):
    points = [
        EntryPoint("loop", "fractions:Fraction", bus.GROUP),
        EntryPoint("other", "json:loads", bus.GROUP),
    ]
    monkeypatch.setattr(bus, "entry_points", lambda group: points if group == bus.GROUP else [])


def test_a_registered_bus_is_found(registered):
    from fractions import Fraction

    assert bus.find_bus("loop") is Fraction
    assert bus.available_buses() == ("loop", "other")


def test_an_unknown_bus_lists_those_there_are(registered):
    with pytest.raises(LookupError, match="no EtherCAT bus 'soem'; available: loop, other"):
        bus.find_bus("soem")


def test_no_bus_at_all(monkeypatch):
    monkeypatch.setattr(bus, "entry_points", lambda group: [])
    with pytest.raises(LookupError, match="available: none"):
        bus.find_bus("sim")


def test_an_abort_says_what_was_refused():
    assert str(bus.SdoAbort(0x06010002, 3, 0x6064, 0)) == (
        "slave 3, object 0x6064:0: abort 0x06010002, read-only object"
    )

"""Definitions of messages: whole, with their comments, and with the hash that ROS has for them."""

from __future__ import annotations

import importlib
import re

import pytest

pytest.importorskip("ament_index_python")
pytest.importorskip("husky_msgs")

from ament_index_python.packages import PackageNotFoundError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from husky_bringup import definitions
from husky_bringup.definitions import Definitions, UnknownTypeError, message_class

KINDS = (
    "rcl_interfaces/msg/ParameterEvent",
    "sensor_msgs/msg/PointCloud2",
    "std_msgs/msg/Empty",
    "diagnostic_msgs/msg/DiagnosticArray",
    "rcl_interfaces/msg/ParameterDescriptor",
    "nav_msgs/msg/Odometry",
)
JAZZY = get_typestore(Stores.ROS2_JAZZY)


@pytest.mark.parametrize("kind", KINDS)
def test_a_definition_is_whole_and_of_the_type(kind: str) -> None:
    """By a parser that knows nothing else, and a hash that was computed elsewhere."""
    read = get_typestore(Stores.EMPTY)
    read.register(get_types_from_msg(Definitions().text(kind), kind))
    assert read.hash_rihs01(kind) == JAZZY.hash_rihs01(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_a_package_that_has_only_classes_will_do(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nowhere(package: str) -> str:
        raise PackageNotFoundError(package)

    monkeypatch.setattr(definitions, "get_package_share_directory", nowhere)
    known = Definitions()
    text = known.text(kind)
    assert "#" not in text
    assert known.typestore.hash_rihs01(kind) == JAZZY.hash_rihs01(kind)


HALVES = (
    "std_srvs/srv/Trigger_Request",
    "std_srvs/srv/SetBool_Response",
    "rcl_interfaces/srv/DescribeParameters_Response",
    "husky_msgs/srv/PlanCycle_Request",
)


@pytest.mark.parametrize("kind", HALVES)
@pytest.mark.parametrize("has_files", [True, False])
def test_half_of_a_service_has_the_fields_of_its_class(
    kind: str, has_files: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nowhere(package: str) -> str:
        raise PackageNotFoundError(package)

    if not has_files:
        monkeypatch.setattr(definitions, "get_package_share_directory", nowhere)
    read = get_typestore(Stores.EMPTY)
    name = kind.replace("/srv/", "/msg/")
    read.register(get_types_from_msg(Definitions().text(kind), name))
    package, service, half = re.split(r"/srv/|_(?=Re)", kind)
    found = getattr(getattr(importlib.import_module(f"{package}.srv"), service), half)
    fields = [field for field, _ in read.fielddefs[name][1]]
    empty = ["structure_needs_at_least_one_member"]
    assert (fields or empty) == (list(found.get_fields_and_field_types()) or empty)


@pytest.mark.parametrize(
    "kind",
    [
        "std_srvs/srv/Trigger_Odd",
        "std_srvs/srv/Odd_Request",
        "nobody_msgs/msg/Odd",
        "sensor_msgs/msg/Odd",
        "std_srvs/srv/Trigger",
        "Odd",
    ],
)
def test_what_is_not_there_is_named(kind: str) -> None:
    with pytest.raises(UnknownTypeError, match=kind):
        Definitions().text(kind)


def test_a_message_is_no_service() -> None:
    with pytest.raises(ValueError, match="no message"):
        message_class("std_srvs/srv/Trigger")

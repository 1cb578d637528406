"""`ros2 service`: which services there are, calling one, and printing the calls of one."""

import argparse
import time
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_services_default
from service_msgs.msg import ServiceEventInfo

from standin.arguments import (
    CSV,
    NODE,
    SHORTENING,
    SHOW_TYPES,
    argument,
    count_only,
    given_values,
    include_hidden,
    takes,
    values,
)
from standin.graph import (
    call,
    discover,
    graph_node,
    print_found,
    print_names,
    print_types,
    services,
)
from standin.messages import (
    Shortening,
    dump,
    fill,
    interface_class,
    load_values,
    plain,
    to_csv,
)

SERVICE_NAME = argument("service_name", help="name of the service (e.g. '/reset')")
TYPE_HELP = "type of the service (e.g. 'std_srvs/srv/Empty')"
HIDDEN = include_hidden("services", default=argparse.SUPPRESS)
EVENTS = {
    getattr(ServiceEventInfo, name): name
    for name in ("REQUEST_SENT", "REQUEST_RECEIVED", "RESPONSE_SENT", "RESPONSE_RECEIVED")
}


@takes(*NODE, SHOW_TYPES, count_only("services"), HIDDEN)
def list_main(args: argparse.Namespace) -> None:
    """Print the services of the graph."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        found = services(node, args.include_hidden_services)
    print_names(found, args, args.count_services)


@takes(*NODE, SERVICE_NAME)
def type_main(args: argparse.Namespace) -> int:
    """Print the types of a service; code 1 when there is no such service."""
    return print_types(args, args.service_name, lambda node: services(node, hidden=True))


@takes(
    *NODE,
    argument("service_type", help="type of the services (e.g. 'std_srvs/srv/Empty')"),
    count_only("services"),
    HIDDEN,
)
def find_main(args: argparse.Namespace) -> None:
    """Print the services of a type."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        found = services(node, args.include_hidden_services)
    print_found(found, args.service_type, args.count_services)


@takes(*NODE, SERVICE_NAME)
def info_main(args: argparse.Namespace) -> str | None:
    """Print a service's type and how many call and serve it."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        types = dict(services(node, args.include_hidden_services)).get(args.service_name)
        if types is None:
            return f"Unknown service '{args.service_name}'"
        print(f"Type: {types[0] if len(types) == 1 else types}")
        print(f"Clients count: {node.count_clients(args.service_name)}")
        print(f"Services count: {node.count_services(args.service_name)}")
    return None


@takes(
    SERVICE_NAME,
    argument("service_type", help=TYPE_HELP),
    values("the request's fields as YAML (e.g. '{a: 1, b: 2}')"),
    argument(
        "-r", "--rate", metavar="N", type=float, help="repeat the call so many times a second"
    ),
)
def call_main(args: argparse.Namespace) -> str | None:
    """Call a service once, or at a rate until interrupted; a string is what went wrong."""
    if args.rate is not None and args.rate <= 0:
        raise RuntimeError("rate must be greater than zero")
    try:
        service_class = interface_class(args.service_type, "srv")
    except ValueError as error:
        is_other = str(error).startswith("not a")
        raise RuntimeError(
            "The passed type is not a service" if is_other else "The passed service type is invalid"
        ) from None
    request = service_class.Request()
    fields = load_values(given_values(args))
    try:
        fill(request, fields)
    except Exception as error:  # whatever the request's own setters raise is the user's answer
        return f"Failed to populate field: {error}"
    package, name = args.service_type.split("/")[0], args.service_type.split("/")[-1]
    with graph_node(args, f"_ros2cli_requester_{package}_{name}") as node:
        client = node.create_client(service_class, args.service_name)
        if not client.service_is_ready():
            print("waiting for service to become available...")
            client.wait_for_service()
        while True:
            print(f"requester: making request: {request!r}\n")
            started = time.monotonic()
            print(f"response:\n{call(node, client, request)!r}\n")
            if args.rate is None or not rclpy.ok():
                return None
            time.sleep(max(0.0, started + 1.0 / args.rate - time.monotonic()))


# ------------------------------------------------------------------ echo
@takes(*NODE, SERVICE_NAME, argument("service_type", nargs="?", help=TYPE_HELP), CSV, *SHORTENING)
def echo_main(args: argparse.Namespace) -> None:
    """Print requests and responses until interrupted."""
    shortening = Shortening.chosen(args)

    def on_event(event: Any) -> None:
        if args.csv:
            print(to_csv(event, shortening))
            return
        shown = plain(event, shortening)
        shown["info"]["event_type"] = EVENTS[event.info.event_type]
        print(dump(shown, args.flow_style), end="---\n")

    with graph_node(args) as node:
        topic = f"{args.service_name}/_service_event"
        event_class = service_class(node, args).Event
        events = node.create_subscription(
            event_class, topic, on_event, qos_profile_services_default
        )
        discover(node, args.spin_time, lambda: events.get_publisher_count() > 0)
        if events.get_publisher_count() == 0:
            print(
                f"No publishers on topic '{topic}'; "
                "is service introspection on the client or server enabled?"
            )
        while rclpy.ok():
            rclpy.spin_once(node)


def service_class(node: Node, args: argparse.Namespace) -> Any:
    """The class of the service, as the command line or the graph names it; else RuntimeError."""
    wanted = args.service_type
    if wanted is None:

        def types() -> list[str]:
            return dict(services(node, hidden=True)).get(args.service_name, [])

        discover(node, args.spin_time, lambda: bool(types()))
        found = types()
        if not found:
            raise RuntimeError(f"Cannot find type for '{args.service_name}'")
        if len(found) > 1:
            raise RuntimeError(f"More than one type associated with service '{args.service_name}'")
        (wanted,) = found
    try:
        return interface_class(wanted, "srv")
    except ValueError:
        raise RuntimeError(f"The service type '{wanted}' is invalid") from None

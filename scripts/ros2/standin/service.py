"""`ros2 service`: which services there are, and calling one."""

import argparse
import time

import rclpy

from standin.arguments import given_values
from standin.graph import add_node_arguments, call, discover, graph_node, print_names, services
from standin.messages import fill, interface_class, load_values


def add_shared_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments between `service` and the verb."""
    parser.add_argument(
        "--include-hidden-services", action="store_true", help="consider hidden services as well"
    )


def add_list_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `service list`."""
    add_node_arguments(parser)
    parser.add_argument("-t", "--show-types", action="store_true", help="show the types as well")
    parser.add_argument(
        "-c", "--count-services", action="store_true", help="show only how many there are"
    )
    parser.add_argument(
        "--include-hidden-services",
        action="store_true",
        default=argparse.SUPPRESS,
        help="consider hidden services as well",
    )


def list_main(args: argparse.Namespace) -> None:
    """Print the services of the graph."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        found = services(node, args.include_hidden_services)
    print_names(found, args, args.count_services)


def add_type_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `service type`."""
    add_node_arguments(parser)
    parser.add_argument("service_name", help="name of the service (e.g. '/reset')")


def type_main(args: argparse.Namespace) -> int:
    """Print the types of a service; code 1 when there is no such service."""
    with graph_node(args) as node:
        discover(
            node, args.spin_time, lambda: args.service_name in dict(services(node, hidden=True))
        )
        types = dict(services(node, hidden=True)).get(args.service_name, [])
    for name in types:
        print(name)
    return 0 if types else 1


def add_call_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `service call`."""
    parser.add_argument("service_name", help="name of the service (e.g. '/reset')")
    parser.add_argument("service_type", help="type of the service (e.g. 'std_srvs/srv/Empty')")
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        "values", nargs="?", default="{}", help="the request's fields as YAML (e.g. '{a: 1, b: 2}')"
    )
    source.add_argument("--stdin", action="store_true", help="read the fields from standard input")
    parser.add_argument(
        "-r", "--rate", metavar="N", type=float, help="repeat the call so many times a second"
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
    values = load_values(given_values(args))
    try:
        fill(request, values)
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

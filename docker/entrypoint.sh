#!/usr/bin/env bash
# Entry point of the image: `ros2 run PACKAGE NODE ...`, or any other command, in a shell in which everything works.
# With HUSKY_TIME it writes the parameters of every node, from husky_bringup's table, to HUSKY_PARAMETERS first:
#   HUSKY_TIME       lockstep or realtime
#   HUSKY_SETTINGS   more parameters, NODE.PARAMETER=VALUE, separated by spaces
#   HUSKY_ETHERCAT   a network, as 10.136.164.0: drive_bridge and drive_segment send their frames on the interface into it
# `scenario NAME` plays a scenario of husky_experiments.scenario on the robot that these describe; `bringup` starts it, as
# scripts/bringup.sh does and with its options.
set -euo pipefail
. /opt/husky/scripts/env.sh

read -r -a settings <<< "${HUSKY_SETTINGS:-}"
if [ -n "${HUSKY_ETHERCAT:-}" ]; then
    # Names of interfaces follow the order in which an engine connects networks: ask the routing table instead.
    IFS=. read -r a b c d <<< "$HUSKY_ETHERCAT"
    network="$(printf '%02X' "$d" "$c" "$b" "$a")"
    interface="$(while read -r name destination _; do [ "$destination" != "$network" ] || echo "$name"; done < /proc/net/route)"
    if [ -z "$interface" ]; then
        echo "error: no network interface leads into HUSKY_ETHERCAT=$HUSKY_ETHERCAT" >&2
        exit 1
    fi
    settings+=("drive_bridge.interface=$interface" "drive_segment.interface=$interface")
fi
robot=(--time "${HUSKY_TIME:-realtime}" "${settings[@]/#/--set=}")
if [ "${1:-}" = scenario ]; then
    exec python -P -m husky_experiments.scenario "${@:2}" "${robot[@]}"
fi
if [ "${1:-}" = bringup ]; then
    exec python -P -m husky_bringup.front -m husky_bringup.bringup "${robot[@]}" "${@:2}"
fi
if [ -n "${HUSKY_TIME:-}" ]; then
    python -P -m husky_bringup.parameter_file "${robot[@]}" > "$HUSKY_PARAMETERS"
fi

# The genuine `ros2 run` stays as the node's parent, dies of SIGTERM and takes the node's end with it: become the node.
if [ "${1:-} ${2:-}" = "ros2 run" ] && [ $# -ge 4 ]; then
    IFS=: read -r -a prefixes <<< "$AMENT_PREFIX_PATH"
    for prefix in "${prefixes[@]}"; do
        if [ -x "$prefix/lib/$3/$4" ]; then
            exec "$prefix/lib/$3/$4" "${@:5}"
        fi
    done
fi
exec "$@"

#!/usr/bin/env bash
# Starts every node of the robot with `ros2 run`, one process each; Ctrl-C or SIGTERM ends them all. --help tells the options.
set -euo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"
"$root/scripts/setup.sh"
. "$root/scripts/env.sh"
exec python -m husky_bringup.bringup "$@"

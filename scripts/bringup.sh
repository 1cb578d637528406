#!/usr/bin/env bash
# Starts every node of the robot, one process each; Ctrl-C, or the end of one, ends them all. --help tells the options.
. "$(dirname "${BASH_SOURCE[0]}")/front.sh"
exec python -m husky_bringup.front -m husky_bringup.bringup "$@"

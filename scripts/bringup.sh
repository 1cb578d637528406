#!/usr/bin/env -S bash -p
# Starts every node of the robot, one process each; Ctrl-C, or the end of one, ends them all. --help tells the options.
case "$-" in *p*) ;; *) exec "${BASH:-/bin/bash}" -p "$0" "$@" ;; esac
. "$(dirname "$(readlink -f "$0")")/front.sh" || exit
on_wire "$@"
exec python -P -m husky_bringup.front -m husky_bringup.bringup "$@"

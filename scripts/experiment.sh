#!/usr/bin/env -S bash -p
# Runs one experiment through the full graph in lockstep; results in out/NAME/, the last line is JSON. Without NAME it lists them.
case "$-" in *p*) ;; *) exec "${BASH:-/bin/bash}" -p "$0" "$@" ;; esac
. "$(dirname "$(readlink -f "$0")")/front.sh" || exit
on_wire "$@"
exec python -P -m husky_bringup.front -m husky_experiments "$@"

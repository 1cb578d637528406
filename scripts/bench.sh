#!/usr/bin/env -S bash -p
# Runs one benchmark with its baseline; the last line is JSON. Without NAME it lists them.
case "$-" in *p*) ;; *) exec "${BASH:-/bin/bash}" -p "$0" "$@" ;; esac
. "$(dirname "$(readlink -f "$0")")/front.sh" || exit
[ "${1:-}" != ethercat ] || in_wired_network "$@"
exec python -P -m husky_bringup.front "$root/tests/benchmarks/run.py" "$@"

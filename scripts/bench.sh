#!/usr/bin/env bash
# Runs one benchmark with its baseline; the last line is JSON. Without NAME it lists them.
. "$(dirname "${BASH_SOURCE[0]}")/front.sh"
exec python -m husky_bringup.front "$root/tests/benchmarks/run.py" "$@"

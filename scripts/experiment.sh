#!/usr/bin/env bash
# Runs one experiment through the full graph in lockstep; results in out/NAME/, the last line is JSON. Without NAME it lists them.
. "$(dirname "${BASH_SOURCE[0]}")/front.sh"
exec python -m husky_bringup.front -m husky_experiments "$@"

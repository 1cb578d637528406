#!/usr/bin/env bash
# Runs one experiment through the full graph in lockstep; results in out/NAME/, the last line is JSON. Without NAME it lists them.
set -euo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"
"$root/scripts/setup.sh"
. "$root/scripts/env.sh"
exec python -m husky_bringup.experiments "$@"

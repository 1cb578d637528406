#!/usr/bin/env bash
# Runs one benchmark with its baseline; the last line is JSON. Without NAME it lists them.
set -euo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"
"$root/scripts/setup.sh"
. "$root/scripts/env.sh"
exec python "$root/tests/benchmarks/run.py" "$@"

#!/usr/bin/env bash
# Sets up if needed, runs the robot (stand, trot 5 m, sit), shows what it did: figures, a video, a summary.
set -euo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"
"$root/scripts/setup.sh"
. "$root/scripts/env.sh"
python -m husky_bringup.experiments demo "$@"

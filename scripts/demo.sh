#!/usr/bin/env bash
# Sets up if needed, runs the robot (stand, trot 5 m, sit), shows what it did: figures, a video, a summary.
. "$(dirname "${BASH_SOURCE[0]}")/front.sh"
exec python -m husky_bringup.front -m husky_experiments demo "$@"

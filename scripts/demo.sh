#!/usr/bin/env -S bash -p
# Sets up if needed, runs the robot (stand, trot 5 m, sit), shows what it did: figures, a video, a summary.
case "$-" in *p*) ;; *) exec "${BASH:-/bin/bash}" -p "$0" "$@" ;; esac
. "$(dirname "$(readlink -f "$0")")/front.sh" || exit
exec python -P -m husky_bringup.front -m husky_experiments demo "$@"

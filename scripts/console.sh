#!/usr/bin/env -S bash -p
# Shows a running robot in the browser; Ctrl-C ends the page, not the robot. --help tells the options.
case "$-" in *p*) ;; *) exec "${BASH:-/bin/bash}" -p "$0" "$@" ;; esac
. "$(dirname "$(readlink -f "$0")")/front.sh" || exit
exec python -P -m husky_bringup.console "$@"

#!/usr/bin/env bash
# Shows a running robot in the browser; Ctrl-C ends the page, not the robot. --help tells the options.
. "$(dirname "${BASH_SOURCE[0]}")/front.sh"
exec python -m husky_bringup.console "$@"

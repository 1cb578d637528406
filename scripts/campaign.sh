#!/usr/bin/env -S bash -p
# Runs a campaign: an experiment over conditions and seeds (docs/campaigns.md); the last line is JSON. Without FILE it lists those here.
case "$-" in *p*) ;; *) exec "${BASH:-/bin/bash}" -p "$0" "$@" ;; esac
. "$(dirname "$(readlink -f "$0")")/front.sh" || exit
exec python -P -m husky_bringup.front -m husky_experiments.campaign "$@"

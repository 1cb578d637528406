#!/bin/sh
# Healthy is a node that has served its timers within the last 5 s (husky_runtime.nodes.run).
set -eu
beat="$(stat -c %Y "$HUSKY_HEARTBEAT")"
[ "$(($(date +%s) - beat))" -le 5 ]

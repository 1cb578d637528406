#!/usr/bin/env bash
# Sets up if needed and tests. Ends with pytest's summary line; the exit code is 0 only when everything passed.
#
#   scripts/test.sh                     lint, types, every test, coverage of the pure parts
#   scripts/test.sh [pytest arguments]  these tests only, e.g. scripts/test.sh ros2_ws/src/husky_control -k gait
#   scripts/test.sh --docker            the graph across containers, on the Docker engine that is there; where there is none
#                                       root gets one of its own (tests/docker/engine.sh). With CI=true they run before all others
set -euo pipefail

root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"
"$root/scripts/setup.sh"
. "$root/scripts/env.sh"

if [ "${1:-}" = --docker ]; then
    export HUSKY_DOCKER=yes
    shift
    set -- "$root/tests/docker" "$@"
fi

# Arguments may name files relative to where the caller stands.
if [ $# -gt 0 ]; then
    exec python -m pytest --rootdir "$root" -c "$root/pyproject.toml" "$@"
fi

cd "$root"
code=0
check() { # name, command
    local name="$1"
    shift
    if "$@"; then
        echo "$name: passed"
    else
        echo "$name: FAILED (the tests follow; the exit code will tell)"
        code=1
    fi
}
check ruff ruff check --output-format concise .
check mypy mypy --exclude '(^|/)nodes/' ros2_ws/src/husky_*/husky_*
# In a process of their own: Fast DDS looks for network interfaces once, and these make one.
if [ "${CI:-}" = true ]; then
    HUSKY_DOCKER=yes python -m pytest tests/docker || code=$?
fi
python -m pytest --cov --cov-report=term:skip-covered || code=$?
exit "$code"

#!/usr/bin/env bash
# Sets up if needed and tests. Ends with pytest's summary line; the exit code is 0 only when everything passed.
#
#   scripts/test.sh                     lint, types, every test
#   scripts/test.sh [pytest arguments]  these tests only, e.g. scripts/test.sh ros2_ws/src/husky_control -k gait
#   scripts/test.sh --docker            the graph across containers, on the Docker engine that is there; where there is none
#                                       root gets one of its own (tests/docker/engine.sh). With CI=true they run beside all others
#
# Without arguments the test files run side by side, one for each processor (HUSKY_TEST_WORKERS says how many).
. "$(dirname "${BASH_SOURCE[0]}")/front.sh"

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
# Who runs below this shell ends with it, also when it is killed (husky_runtime.starter).
status="$(< "/proc/$$/stat")"
read -r -a status <<< "${status##*) }"
export HUSKY_STARTER="$$:${status[19]}"
# A graph is a chain of processes, of which about one runs at a time: it keeps one processor busy, not two.
workers="${HUSKY_TEST_WORKERS:-$(nproc)}"
[ "$workers" -le 4 ] || workers=4 # what they start needs memory too
if [ "${CI:-}" = true ]; then
    export HUSKY_DOCKER=yes
    workers=$((workers + 1)) # the tests across containers have one to themselves: tests/side_by_side.py
fi
in_turn python -m pytest -n "$workers" --dist loadfile

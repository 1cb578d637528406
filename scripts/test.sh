#!/usr/bin/env -S bash -p
# Sets up if needed and tests. Ends with pytest's summary line, behind which stands what the run took where no file is named; the
# exit code is 0 only when everything passed.
#
#   scripts/test.sh                     lint, types and the tests that a change must pass; what CI runs
#   scripts/test.sh --all               these, what is marked docker, bare, realtime or slow, and coverage: before a release
#   scripts/test.sh [pytest arguments]  these tests only, e.g. scripts/test.sh ros2_ws/src/husky_control -k gait
#
# Where no file or directory is named the test files run side by side, one more than processors (HUSKY_TEST_WORKERS says how many).
# docs/testing.md tells what each marker means and where the time goes.
case "$-" in *p*) ;; *) exec "${BASH:-/bin/bash}" -p "$0" "$@" ;; esac
. "$(dirname "$(readlink -f "$0")")/front.sh" || exit

options=(-m "not (docker or bare or realtime or slow)")
workers="${HUSKY_TEST_WORKERS:-$(($(nproc) + 1))}" # one waits for an event now and then
[ "$workers" -le 5 ] || workers=5 # what they start needs memory too
if [ "${1:-}" = --all ]; then
    shift
    options=(--cov --cov-report=term:skip-covered)
    workers=$((workers + 1)) # the tests across containers have one to themselves: tests/side_by_side.py
fi

# Arguments may name files relative to where the caller stands.
for argument in "$@"; do
    if [ -e "${argument%%::*}" ]; then
        exec python -P -m pytest --rootdir "$root" -c "$root/pyproject.toml" "$@"
    fi
done

cd "$root"
# Everything below this shell ends with it, also when it is killed (husky_runtime.starter).
status="$(< "/proc/$$/stat")"
read -r -a status <<< "${status##*) }"
export HUSKY_STARTER="$$:${status[19]}"
# One worker runs the graphs, each of which keeps two processors busy now and then; the others run the rest: tests/side_by_side.py
TIMEFORMAT="took %0R s, and %0U s (user) + %0S s (system) of processor time"
time in_turn python -P -m pytest -n "$workers" --dist loadfile --durations=25 --durations-min=5 "${options[@]}" "$@"

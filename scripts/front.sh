# Sourced by the scripts that run something: sets up, gives `$root` and the environment. A signal ends what runs and the script,
# with exit code 128 + n; until the script becomes the program that it runs, which then does the same.
set -euo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"

_husky_group=""

_husky_end() { # name and number of the signal
    echo "ended by SIG$1" >&2
    # A group of its own: set-up has installers and compilers below it.
    [ -z "$_husky_group" ] || kill -TERM -- "-$_husky_group" 2> /dev/null || true
    exit $((128 + $2))
}
trap '_husky_end HUP 1' HUP
trap '_husky_end INT 2' INT
trap '_husky_end QUIT 3' QUIT
trap '_husky_end TERM 15' TERM

# Runs a command and returns its exit code. The shell waits, since what it runs in its foreground keeps signals from it.
in_turn() {
    local code=0
    set -m
    "$@" &
    set +m
    _husky_group=$!
    wait "$_husky_group" || code=$?
    _husky_group=""
    return "$code"
}

in_turn "$root/scripts/setup.sh"
. "$root/scripts/env.sh"

# Sourced by the scripts that run something: sets up, gives `$root` and the environment. A signal ends what runs and the script,
# with exit code 128 + n; until the script becomes the program that it runs, which then does the same.
# Each of them is run by `bash -p`, also as `bash scripts/demo.sh`: no function, option or search path of the caller's comes along.
set -euo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"

if ! readlink -e . > /dev/null; then
    echo "error: the working directory has been deleted; change to one that exists" >&2
    exit 1
fi

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

# Discovery or security that was set up for something else ends in silence: nodes that do not find each other. What is started and
# ended here has a graph of its own; a robot that stays may be meant to be found that way.
other_discovery() {
    local name
    for name in ROS_DISCOVERY_SERVER ROS_SUPER_CLIENT FASTDDS_BUILTIN_TRANSPORTS FASTDDS_ENVIRONMENT_FILE \
        FASTDDS_DEFAULT_PROFILES_FILE FASTRTPS_DEFAULT_PROFILES_FILE ROS_AUTOMATIC_DISCOVERY_RANGE \
        ROS_STATIC_PEERS ROS_SECURITY_ENABLE; do
        case "${!name:-}" in
            "" | "$root"/scripts/* | LOCALHOST | SUBNET | SYSTEM_DEFAULT | false) continue ;;
        esac
        case "${0##*/}" in
            bringup.sh | console.sh) echo "note: nodes find each other by $name=${!name}; unset it if they do not" >&2 ;;
            *)
                echo "note: $name=${!name} is left out, nodes find each other on this machine" >&2
                unset "$name"
                ;;
        esac
    done
}

# Starts the script again in a network that has an EtherCAT wire, unless it is in one.
in_wired_network() { # arguments of the script
    if ! grep -q '^ *ecat0:' /proc/net/dev; then
        unset HUSKY_FORK_SERVER # its nodes would be in its own network (husky_bringup.fork_server)
        exec "$root/scripts/wire.sh" "$0" "$@"
    fi
}

# With `--bus soem` the nodes need an EtherCAT wire.
on_wire() { # arguments of the script
    case " $* " in
        *" --bus soem "* | *" --bus=soem "*) in_wired_network "$@" ;;
    esac
}

in_turn "$root/scripts/setup.sh" --if-needed >&2 # the output is that of the program alone
other_discovery
. "$root/scripts/env.sh"

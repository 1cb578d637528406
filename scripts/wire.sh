#!/usr/bin/env -S bash -p
# Runs a command in a network of its own that has an EtherCAT wire: a pair of virtual Ethernet interfaces, ecat0 for the master and
# ecat1 for the simulated drives, and the loopback interface for ROS. Without a command it is a shell. The network ends with the
# last process in it. Needs root, or a kernel that lets users make network namespaces.
#
#   scripts/wire.sh scripts/bringup.sh --bus soem    (scripts that know --bus soem make the wire themselves)
#   scripts/wire.sh --join ros2 topic list           in the network that was made last and is still there
case "$-" in *p*) ;; *) exec "${BASH:-/bin/bash}" -p "$0" "$@" ;; esac
set -euo pipefail
fail() {
    printf 'wire: %s\n' "$@" >&2
    exit 1
}

newest_inside() { # the process of yours that was started last in a network with a wire
    local each
    for each in $(cd /proc && printf '%s\n' [0-9]* | sort -rn); do
        if [ -O "/proc/$each" ] && grep -qs '^ *ecat0:' "/proc/$each/net/dev"; then
            echo "$each"
            return
        fi
    done
}

case "${1:-}" in
    -h | --help)
        sed -n '2,/^case /{/^# \{0,1\}/s///p}' "${BASH_SOURCE[0]}"
        exit 0
        ;;
    --join)
        shift
        pid="$(newest_inside)"
        [ -n "$pid" ] || fail "no network with a wire is there; scripts/wire.sh makes one"
        [ $# -gt 0 ] || set -- "${SHELL:-/bin/bash}"
        as=()
        [ /proc/self/ns/user -ef "/proc/$pid/ns/user" ] || as=(--user --preserve-credentials)
        exec nsenter --target "$pid" --net "${as[@]}" -- "$@"
        ;;
    --inside)
        shift
        ip link set lo up
        ip link add ecat0 type veth peer name ecat1
        for end in ecat0 ecat1; do
            # A quiet wire: nobody asks for neighbours on it.
            echo 1 > "/proc/sys/net/ipv6/conf/$end/disable_ipv6" 2> /dev/null || true
            ip link set "$end" multicast off up
        done
        [ $# -gt 0 ] || set -- "${SHELL:-/bin/bash}"
        exec "$@"
        ;;
esac
command -v unshare ip > /dev/null || fail "needs unshare and ip: sudo apt install util-linux iproute2"
if unshare --net true 2> /dev/null; then
    exec unshare --net -- "$0" --inside "$@"
elif unshare --user --map-current-user --keep-caps --net true 2> /dev/null; then
    exec unshare --user --map-current-user --keep-caps --net -- "$0" --inside "$@"
fi
fail "this kernel does not let you make a network namespace" \
    "run as root, or allow it: sudo sysctl kernel.unprivileged_userns_clone=1 (Debian), kernel.apparmor_restrict_unprivileged_userns=0 (Ubuntu)"

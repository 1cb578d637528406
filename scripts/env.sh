# Source this (bash or zsh): `. scripts/env.sh` gives a shell in which the whole project works. Made possible by setup.sh.
# What is already set is respected: ROS_DOMAIN_ID, ROS_AUTOMATIC_DISCOVERY_RANGE, RMW_IMPLEMENTATION,
# FASTRTPS_DEFAULT_PROFILES_FILE, NUMBA_CACHE_DIR, OPENBLAS_NUM_THREADS, ROS_LOG_DIR; and MUJOCO_GL, by what draws.

_husky_prepend() { # variable, directory: put the directory first, and nowhere else
    eval "_husky_old=:\${$1:-}:"
    case "$_husky_old" in
        *":$2:"*) _husky_old="${_husky_old%%:"$2":*}:${_husky_old#*:"$2":}" ;;
    esac
    _husky_old="${_husky_old#:}"
    _husky_old="${_husky_old%:}"
    eval "export $1=\"\$2\${_husky_old:+:\$_husky_old}\""
}

_husky_ros_from_wheels() { # virtual environment: its prefix is the ROS underlay
    local libraries="" directory
    for directory in "$1"/lib/python3.*/site-packages/ros_*.libs; do
        libraries="$libraries${libraries:+:}$directory"
    done
    _husky_prepend LD_LIBRARY_PATH "$libraries"
    _husky_prepend LD_LIBRARY_PATH "$1/lib"
    _husky_prepend AMENT_PREFIX_PATH "$1"
    _husky_prepend CMAKE_PREFIX_PATH "$1"
    # The wheels start Python anew to set LD_LIBRARY_PATH unless this says that it is done.
    export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
    export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3
}

_husky_workspace() { # ros2_ws: its install space on every search path, its packages' sources importable
    local site package
    for site in "$1"/install/lib/python3.*/site-packages; do
        [ -d "$site" ] && _husky_prepend PYTHONPATH "$site"
    done
    for package in "$1"/build/husky_*/husky_*.egg-info; do
        [ -d "$package" ] && _husky_prepend PYTHONPATH "${package%/*}"
    done
    _husky_prepend LD_LIBRARY_PATH "$1/install/lib"
    _husky_prepend CMAKE_PREFIX_PATH "$1/install"
    _husky_prepend AMENT_PREFIX_PATH "$1/install"
}

_husky_own_directory() { # directories: the first that is ours to write in, made if need be
    local directory
    for directory in "$@"; do
        # What is cached is run: no directory that somebody else has made.
        if mkdir -p "$directory" 2> /dev/null && [ -w "$directory" ] && [ -O "$directory" ]; then
            break
        fi
    done
    echo "$directory"
}

# One machine, one robot: do not meet the neighbours' graph, nor listen to them, unless asked to.
_husky_discovery() { # directory of the profiles
    local range="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}" profiles="${FASTRTPS_DEFAULT_PROFILES_FILE:-}"
    if [ "$profiles" = "$1/fastdds_loopback.xml" ] && [ "$range" = SYSTEM_DEFAULT ]; then
        range=LOCALHOST # said below, when this file was sourced before
    fi
    case "$profiles" in
        "" | "$1"/*)
            profiles="$1/fastdds.xml"
            case "$range,$RMW_IMPLEMENTATION,${ROS_STATIC_PEERS:-}" in
                LOCALHOST,rmw_fastrtps_*,) profiles="$1/fastdds_loopback.xml" range=SYSTEM_DEFAULT ;; # that is: as the file says
            esac
            ;;
    esac
    export ROS_AUTOMATIC_DISCOVERY_RANGE="$range" FASTRTPS_DEFAULT_PROFILES_FILE="$profiles"
}

_husky_env() { # this file's path
    local root venv underlay options="$-"
    [ -z "${ZSH_VERSION:-}" ] || emulate -L sh
    root="$(cd "$(dirname "$1")/.." && pwd -P)"
    venv="$root/.venv"
    if [ ! -f "$venv/ros_underlay" ]; then
        echo "env.sh: nothing set up in $root yet; run $root/scripts/setup.sh first" >&2
        return 1
    fi
    read -r underlay < "$venv/ros_underlay"
    export HUSKY_ROOT="$root"

    if [ "$underlay" = wheels ]; then
        _husky_ros_from_wheels "$venv"
    else
        set +u # ROS's own scripts read variables that are not set
        if [ -n "${ZSH_VERSION:-}" ]; then
            emulate zsh -c ". '$underlay/setup.zsh'"
        else
            . "$underlay/setup.bash"
        fi
        case "$options" in *u*) set -u ;; esac
        # What lies in ~/.local was not chosen for this ROS.
        export PYTHONNOUSERSITE=1
    fi
    export VIRTUAL_ENV="$venv"
    unset PYTHONHOME
    _husky_prepend PATH "$venv/bin"
    _husky_workspace "$root/ros2_ws"

    export RMW_IMPLEMENTATION="${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp}"
    _husky_discovery "$root/scripts"
    # A dozen processes on few cores: no BLAS thread pool in each of them.
    export OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}"
    # A tree that cannot be written works too: what is compiled in it already goes along.
    export NUMBA_CACHE_DIR="${NUMBA_CACHE_DIR:-$(_husky_own_directory "$root/.cache/numba" \
        "${XDG_CACHE_HOME:-${HOME:-/nonexistent}/.cache}/husky/numba" "${TMPDIR:-/tmp}/husky-numba-$(id -u)")}"
    if [ ! -w "$root/.cache/numba" ] && [ -z "$(ls -A "$NUMBA_CACHE_DIR" 2> /dev/null)" ]; then
        cp -R "$root/.cache/numba/." "$NUMBA_CACHE_DIR" 2> /dev/null || true
    fi
    if [ ! -w "${HOME:-/nonexistent}" ]; then
        export ROS_LOG_DIR="${ROS_LOG_DIR:-$(_husky_own_directory "$root/log/ros" "${TMPDIR:-/tmp}/husky-log-$(id -u)")}"
    fi

    # Last on PATH: wherever a genuine ros2 command exists, or comes to exist, it is the one that runs.
    if ! command -v ros2 > /dev/null 2>&1; then
        export PATH="$PATH:$root/scripts/ros2/bin"
    fi
}

if [ -n "${ZSH_VERSION:-}" ]; then
    eval '_husky_env "${(%):-%x}"'
else
    _husky_env "${BASH_SOURCE[0]}"
fi
_husky_status=$?
unset -f _husky_env _husky_discovery _husky_own_directory _husky_prepend _husky_ros_from_wheels _husky_workspace
unset _husky_old
eval "unset _husky_status; return $_husky_status" 2> /dev/null

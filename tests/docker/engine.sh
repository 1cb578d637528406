#!/usr/bin/env bash
# Brings up what the tests in Docker need, and takes it down again.
#
#   tests/docker/engine.sh up DIR      an engine: the one that is there, else one of our own in DIR (root, Debian or Ubuntu);
#                                      and the base image HUSKY_BASE, else debian:12, else one that debootstrap makes.
#                                      Prints DOCKER_HOST=..., DOCKER=... (a client that builds) and BASE=...
#   tests/docker/engine.sh down DIR    ends what `up` has started; of its layers 4 GB stay for the next time
#
# Exit code 3: there can be none on this machine; the last line says why.
set -euo pipefail
command="$1"
directory="$2"

none() { # reason
    echo "$*" >&2
    exit 3
}

quietly() { # command: into the log
    "$@" >> "$directory/engine.log" 2>&1
}

own_engine() {
    [ "$(id -u)" = 0 ] || none "no Docker engine answers, and only root can start one"
    if ! command -v dockerd > /dev/null; then
        command -v apt-get > /dev/null || none "no Docker engine answers, and there is no apt to install one"
        export DEBIAN_FRONTEND=noninteractive
        quietly timeout 120 apt-get update || none "no Docker engine answers, and apt-get update fails"
        quietly timeout 300 apt-get install --yes --no-install-recommends docker.io iptables \
            || none "no Docker engine answers, and docker.io cannot be installed"
    fi
    export DOCKER_HOST="unix://$directory/docker.sock"
    touch "$directory/ours"
    if docker info > /dev/null 2>&1; then # of a run that was killed
        return
    fi
    local storage
    for storage in "" vfs; do # a kernel without overlays has plain copies
        setsid dockerd --data-root "$directory/data" --exec-root "$directory/exec" --pidfile "$directory/dockerd.pid" \
            --host "$DOCKER_HOST" ${storage:+--storage-driver "$storage"} >> "$directory/dockerd.log" 2>&1 < /dev/null &
        local engine=$!
        while kill -0 "$engine" 2> /dev/null; do
            if docker info > /dev/null 2>&1; then
                return
            fi
            sleep 0.5
        done
    done
    none "dockerd does not start: $(grep -v level=info "$directory/dockerd.log" | tail -n 1)"
}

# A client that builds with BuildKit, through buildx or by itself.
building_client() {
    local client
    for client in docker /usr/bin/docker; do
        if "$client" buildx version > /dev/null 2>&1 || [[ "$("$client" --version 2> /dev/null)" == *" 20.10."* ]]; then
            echo "$client"
            return
        fi
    done
    none "there is no Docker client here that builds with BuildKit (docker-buildx)"
}

made_base() { # name: Debian 12 as debootstrap makes it, with this machine's certificates
    [ "$(id -u)" = 0 ] || none "debian:12 cannot be pulled, and only root can make a base with debootstrap"
    if ! command -v debootstrap > /dev/null; then
        quietly timeout 120 apt-get update || none "debian:12 cannot be pulled, and apt-get update fails"
        quietly timeout 120 apt-get install --yes --no-install-recommends debootstrap \
            || none "debian:12 cannot be pulled, and debootstrap cannot be installed"
    fi
    local root="$directory/root"
    rm -rf "$root"
    quietly timeout 600 debootstrap --variant=minbase --include=ca-certificates,python3 bookworm "$root" \
        || none "debian:12 cannot be pulled, and debootstrap fails"
    rm -rf "$root"/var/cache/apt/archives/*.deb "$root"/var/lib/apt/lists/*
    cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
    tar -C "$root" -c . | quietly docker import --change 'ENV PIP_CERT=/etc/ssl/certs/ca-certificates.crt' --change 'CMD ["bash"]' - "$1"
    rm -rf "$root"
}

base_image() {
    local name
    for name in ${HUSKY_BASE:-debian:12 husky-base:bookworm}; do
        if docker image inspect "$name" > /dev/null 2>&1 || quietly timeout 120 docker pull "$name"; then
            echo "$name"
            return
        fi
    done
    [ -z "${HUSKY_BASE:-}" ] || none "the image $HUSKY_BASE cannot be pulled"
    made_base husky-base:bookworm
    echo husky-base:bookworm
}

case "$command" in
    up)
        mkdir -p "$directory"
        docker info > /dev/null 2>&1 || own_engine
        client="$(building_client)"
        base="$(base_image)"
        quietly docker run --rm --entrypoint apt-get "$base" update || none "containers reach no package mirror"
        printf 'DOCKER_HOST=%s\nDOCKER=%s\nBASE=%s\n' "${DOCKER_HOST:-}" "$client" "$base"
        ;;
    down)
        if [ -f "$directory/ours" ] && [ -f "$directory/dockerd.pid" ]; then
            engine="$(cat "$directory/dockerd.pid")"
            export DOCKER_HOST="unix://$directory/docker.sock"
            quietly docker image prune --force || true
            quietly docker builder prune --force --keep-storage 4GB || true
            kill "$engine"
            while kill -0 "$engine" 2> /dev/null; do sleep 0.2; done
            rm -f "$directory/ours"
        fi
        ;;
    *)
        echo "engine.sh: up or down, not $command" >&2
        exit 2
        ;;
esac

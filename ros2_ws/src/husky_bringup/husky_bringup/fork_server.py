"""Starts nodes as forks of a process that has imported their modules.

Most of a node's start is imports (`scripts/bench.sh start`). Where many graphs are started, one
process, the server, imports the modules once, and each node is a fork of it with its own command
line, environment, files, session and process group. Such a node differs from one of the executable
in two ways: `ps` shows the command line of the server (`top` the name of the node), and environment
variables that modules read while they are imported are those of the server.

    with ForkServer() as server:
        process = server.fork("rc_transmitter", ["--ros-args", "-p", "time:=lockstep"], os.environ)
        process.send_signal(signal.SIGTERM)
        process.wait()
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import re
import selectors
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import IO, Any, Self

from husky_runtime import graph

VARIABLE = "HUSKY_FORK_SERVER"
"""Environment variable that names the socket of a server, for programs that start nodes."""
_INTERACTIVE = {graph.CONSOLE, graph.FOXGLOVE_GATEWAY, graph.TELEOP}
"""Nodes that are seldom part of a graph: their modules are not imported before they start."""
_LARGEST_REQUEST = 1 << 20
_STARTED = b"process "
"""Begins the first word to a client; the second one is the exit code alone."""
_LOOK = 0.01
"""Wall time between two looks whether a process has ended [s]."""

_shared: list[str] = []
"""Addresses, of which the last counts."""


@contextlib.contextmanager
def sharing(server: ForkServer) -> Iterator[None]:
    """Have the nodes that this process starts come from a server."""
    _shared.append(server.address)
    try:
        yield
    finally:
        _shared.remove(server.address)


def address(environment: Mapping[str, str]) -> str:
    """Return the address of the server for nodes with an environment, "" where there is none."""
    return _shared[-1] if _shared else environment.get(VARIABLE, "")


class Forked:
    """A process that a server has forked, as `subprocess.Popen` would be.

    Attributes:
        pid: number of the process and of its group.
        returncode: exit code, or minus the signal that ended it; None while it runs. Where the
            server has gone first, it is that of SIGKILL.
    """

    def __init__(self, connection: socket.socket, pid: int):
        """Take a running process.

        Args:
            connection: on which the server tells its end.
            pid: of the process.
        """
        self.pid = pid
        self.returncode: int | None = None
        self._connection = connection

    def poll(self) -> int | None:
        """Return the exit code, None while the process runs."""
        if self.returncode is None:
            try:
                told = self._connection.recv(64, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return None
            except ConnectionError:
                told = b""
            if told or not _is_alive(self.pid):
                self.returncode = int(told) if told else -signal.SIGKILL
                self._connection.close()
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end; return the exit code.

        Raises:
            subprocess.TimeoutExpired: it has not ended within the timeout [s].
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
            time.sleep(_LOOK)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal to the process, unless it has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def fork(
    address: str,
    executable: str,
    arguments: Sequence[str],
    environment: Mapping[str, str],
    output: IO[bytes] | None = None,
) -> Forked:
    """Start a node as a copy of the server's process.

    Args:
        address: of the server's socket.
        executable: name of the node's executable.
        arguments: command line without the executable.
        environment: of the node.
        output: file of what it prints; by default this process's own output and errors.

    Raises:
        OSError: the server does not answer.
    """
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        connection.connect(address)
        request = {
            "arguments": [executable, *arguments],
            "environment": dict(environment),
            "directory": os.getcwd(),
        }
        files = [1, 2] if output is None else [output.fileno()] * 2
        socket.send_fds(connection, [json.dumps(request).encode()], files)
        started, _, number = connection.recv(64).partition(_STARTED)
        if started or not number:  # what comes instead is an exit code, or nothing
            raise ConnectionResetError(f"the server at {address} has not started {executable}")
    except BaseException:
        connection.close()
        raise
    return Forked(connection, int(number))


class ForkServer:
    """A server of our own; use it as a context, at whose end it is gone. Its nodes live on.

    Attributes:
        address: of its socket, for `fork` and `VARIABLE`.
    """

    def __init__(self) -> None:
        """Start it; requests wait until it has imported the modules."""
        self._directory = Path(tempfile.mkdtemp(prefix="husky_fork_server_"))
        self.address = str(self._directory / "socket")
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.bind(self.address)
            listener.listen(64)
            # Its standard input is a pipe that nobody writes to. When that ends, because we are
            # gone, the server removes the directory and ends.
            self._process = subprocess.Popen(
                (sys.executable, "-P", "-m", __name__, str(listener.fileno())),
                stdin=subprocess.PIPE,
                pass_fds=(listener.fileno(),),
                start_new_session=True,
            )

    def fork(
        self,
        executable: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        output: IO[bytes] | None = None,
    ) -> Forked:
        """Start a node; as the function `fork`."""
        return fork(self.address, executable, arguments, environment, output)

    @property
    def running(self) -> bool:
        """True until its process has ended."""
        return self._process.poll() is None

    def close(self) -> None:
        """End the server, if it still runs; remove its directory."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        shutil.rmtree(self._directory, ignore_errors=True)  # of a server that was killed

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End the server."""
        self.close()


# The server's process ---------------------------------------------------------------------------
class _Server:
    """Forks on request, and tells each client how its process has ended."""

    def __init__(self, listener: socket.socket):
        """Take the listening socket."""
        self._listener = listener
        self._children: dict[int, socket.socket] = {}
        self._woken, self._wake = socket.socketpair()
        for end in (self._listener, self._woken, self._wake):
            end.setblocking(False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(self._wake.fileno(), warn_on_full_buffer=False)

    def serve(self) -> str | None:
        """Serve until standard input ends; in a child, return the executable that it is to be."""
        with selectors.DefaultSelector() as selector:
            for file in (self._listener, self._woken, sys.stdin):
                selector.register(file, selectors.EVENT_READ)
            while True:
                for key, _ in selector.select():
                    if key.fileobj is sys.stdin:
                        return None
                    if key.fileobj is self._woken:
                        self._woken.recv(4096)
                        self._tell_of_ends()
                    elif (executable := self._accept()) is not None:
                        return executable

    def _accept(self) -> str | None:
        """Fork for a client; return the executable in the child, None in the server."""
        try:
            connection, _ = self._listener.accept()
        except BlockingIOError:
            return None
        connection.setblocking(True)
        request, files, _, _ = socket.recv_fds(connection, _LARGEST_REQUEST, 2)
        if len(files) == 2:
            pid = os.fork()
            if pid == 0:
                self._become(json.loads(request), files)
                # From the child: by now it leads its group, which the client may signal.
                connection.send(_STARTED + str(os.getpid()).encode())
                connection.close()
                return sys.argv[0]
            self._children[pid] = connection
        for each in files:
            os.close(each)
        return None

    def _tell_of_ends(self) -> None:
        while self._children:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            with self._children.pop(pid) as connection, contextlib.suppress(OSError):
                connection.send(str(os.waitstatus_to_exitcode(status)).encode())

    def _become(self, request: dict[str, Any], files: Sequence[int]) -> None:
        """Leave the server behind: in the child."""
        os.setsid()
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for end in (self._listener, self._woken, self._wake, *self._children.values()):
            end.close()
        null = os.open(os.devnull, os.O_RDONLY)
        for number, file in enumerate((null, *files)):
            os.dup2(file, number)
            os.close(file)
        os.chdir(request["directory"])
        os.environ.clear()
        os.environ.update(request["environment"])
        sys.argv = request["arguments"]
        Path("/proc/self/comm").write_text(sys.argv[0])


def main() -> None:
    """Serve on the listening socket whose descriptor the command line names."""
    listener = socket.socket(fileno=int(sys.argv[1]))
    scripts = entry_points(group="console_scripts")
    nodes = {s.name: s for s in scripts if re.fullmatch(r"husky_\w+\.nodes\.\w+", s.module)}
    for name, script in nodes.items():
        if name not in _INTERACTIVE:
            script.load()
    gc.collect()
    gc.freeze()
    directory = Path(listener.getsockname()).parent
    if (executable := _Server(listener).serve()) is not None:
        if executable not in nodes:
            sys.exit(f"error: no node {executable!r}; there are {', '.join(sorted(nodes))}")
        sys.exit(nodes[executable].load()())
    shutil.rmtree(directory, ignore_errors=True)


if __name__ == "__main__":
    main()

"""The flight controller's memory: parameters that were set by hand and outlast the process.

One sealed file (`husky_runtime.stored_file`) with a JSON object of names and values. It is
written by a thread, so that no tick waits for a disk.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from pathlib import Path

from husky_runtime.stored_file import DamagedFileError, read_sealed, write_sealed


class ParameterFile:
    """Reads what was kept, and keeps what is set.

    Attributes:
        values: what the file held, by name.
        warning: what was wrong with it, "" for nothing; then `values` is empty.
        problem: why the newest values could not be written, "" when they could.
    """

    def __init__(self, path: Path):
        """Read the file, if there is one; a damaged one is put aside as `<name>.damaged`.

        Args:
            path: of the file; its directory is made if need be.

        Raises:
            OSError: it cannot be read, or its directory not be made.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path = path
        self.values: dict[str, float] = {}
        self.warning = self.problem = ""
        try:
            self.values = _values(read_sealed(path), path)
        except FileNotFoundError:
            pass
        except DamagedFileError as error:
            aside = path.with_name(f"{path.name}.damaged")
            path.replace(aside)
            self.warning = f"{error}; kept as {aside.name}, going on without stored parameters"
        self._told = ""
        self._next: bytes | None = None
        self._ended = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._write, name="parameters", daemon=True)
        self._thread.start()

    def keep(self, values: Mapping[str, float]) -> None:
        """Have these values written, soon."""
        content = json.dumps(dict(values), indent=1, sort_keys=True).encode()
        with self._changed:
            self._next = content
            self._changed.notify()

    def news(self) -> str:
        """Return why values are no longer written, once each time that it happens, else ""."""
        problem = self.problem
        told, self._told = self._told, problem
        return problem if problem and not told else ""

    def close(self) -> None:
        """Write what is still to be written."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()

    def _write(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._next is not None or self._ended)
                content, self._next = self._next, None
            if content is None:
                return
            try:
                write_sealed(self._path, content)
                self.problem = ""
            except OSError as error:
                self.problem = f"{self._path}: {error.strerror}"


def _values(content: bytes, path: Path) -> dict[str, float]:
    """Return names and values in a file's content; raises DamagedFileError for other things."""
    try:
        values = json.loads(content)
    except ValueError:
        values = None
    if not isinstance(values, dict) or not all(
        isinstance(value, int | float) and not isinstance(value, bool) for value in values.values()
    ):
        raise DamagedFileError(f"{path} holds no parameters")
    return values

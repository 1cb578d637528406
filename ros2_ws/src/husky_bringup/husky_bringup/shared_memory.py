"""What Fast DDS leaves of a participant that was killed: its segment of shared memory, half a MB.

As long as it lives it has the lock on the file `<segment>_el`: by that `fastdds shm clean`, the
vendor's own broom, goes too. Ports (`fastrtps_port<number>`) stay: whoever comes next takes them.
"""

from __future__ import annotations

import contextlib
import fcntl
import time
from pathlib import Path

_DIRECTORY = Path("/dev/shm")
_LOCKS = f"fastrtps_{'[0-9a-f]' * 16}_el"
_YOUNG = 5.0
"""Age of a lock that its participant may not have taken yet [s of wall time]."""


def sweep(directory: Path = _DIRECTORY) -> list[str]:
    """Remove the segments of participants that are gone, whosever they were; return their names.

    Those of other users stay, and so do the youngest.
    """
    swept = []
    for lock in sorted(directory.glob(_LOCKS)):
        with contextlib.suppress(OSError):
            if time.time() - lock.stat().st_mtime > _YOUNG and _is_free(lock):
                segment = lock.with_name(lock.name.removesuffix("_el"))
                segment.unlink(missing_ok=True)
                lock.unlink()
                swept.append(segment.name)
    return swept


def _is_free(lock: Path) -> bool:
    """Return whether nobody has a lock; raises OSError for one that is not ours to try."""
    with lock.open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True

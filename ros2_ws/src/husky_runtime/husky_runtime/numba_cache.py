"""numba's cache of compiled functions, sealed: code that is damaged is compiled anew, never run.

numba itself reads what it finds: a flipped bit in its cache ends the process, each time that it
starts, or runs as it is. Before it reads, it fills the tables of its compiler, and imports half of
SciPy for them: a third of a second of each start, which only compiling needs.
"""

from __future__ import annotations

import contextlib
import io
import logging
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from husky_runtime.stored_file import DamagedFileError, read_sealed, write_sealed

_log = logging.getLogger(__name__)


def seal_numba_cache() -> None:
    """Make numba, if this process has imported it, write and check seals; call it before compiling.

    Functions that are compiled already are loaded without the compiler's tables.
    The seal stands behind what numba's own readers take from a file. Where nothing can be written,
    functions are compiled in each process.
    """
    caching = sys.modules.get("numba.core.caching")
    if caching is None or hasattr(caching.IndexDataCacheFile, "husky_sealed"):
        return
    from numba.core.runtime import nrt as runtime

    files, cache = caching.IndexDataCacheFile, caching.Cache
    load, save = files.load, cache.save_overload

    def checked_load(self: Any, key: Any) -> Any:
        path = Path(self._index_path)
        try:
            read_sealed(path)
            name = self._load_index().get(key)
            if name is None:
                return None
            path = Path(self._data_path(name))
            read_sealed(path)
            return load(self, key)
        except FileNotFoundError:
            return None
        except (OSError, DamagedFileError, ImportError, AttributeError) as error:
            # What the functions were made of may have moved since.
            _log.warning("%s; compiled anew", error)
            with contextlib.suppress(OSError):
                path.unlink()
            return None

    @contextlib.contextmanager
    def sealed_write(self: Any, path: str) -> Iterator[io.BytesIO]:
        content = io.BytesIO()
        yield content
        write_sealed(Path(path), content.getvalue())

    def load_alone(self: Any, signature: Any, target: Any) -> Any:
        # What compiled code may refer to outside of itself: functions that allocate arrays.
        runtime.rtsys.initialize(target)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target)

    def patient_save(self: Any, *arguments: Any) -> None:
        try:
            save(self, *arguments)
        except OSError as error:
            _log.warning("compiled functions are not kept: %s", error)

    files.load, files._open_for_write = checked_load, sealed_write
    cache.load_overload, cache.save_overload = load_alone, patient_save
    files.husky_sealed = True

"""numba's cache of compiled functions: what is damaged or outdated is compiled anew, never run.

numba itself reads what it finds: a flipped bit in its cache ends the process, each time that it
starts, or runs as it is. It compares the file of a function, but not those of the functions that it
calls and of the constants that it reads, which are part of the compiled code as well.
Before it reads, it fills the tables of its compiler, and imports half of SciPy for them: a third
of a second of each start, which only compiling needs.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import logging
import sys
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from husky_runtime.stored_file import DamagedFileError, read_sealed, write_sealed

_log = logging.getLogger(__name__)


def seal_numba_cache() -> None:
    """Make numba, if this process has imported it, write and check seals; call it before compiling.

    Functions that are compiled already are loaded without the compiler's tables, unless something
    that they call or read has changed since. The seal, and a digest of all that, stand behind what
    numba's own readers take from a file. Where nothing can be written, functions are compiled in
    each process.
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
            if not read_sealed(path).endswith(self.husky_fingerprint):
                return None
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
        write_sealed(Path(path), content.getvalue() + self.husky_fingerprint)

    def load_alone(self: Any, signature: Any, target: Any) -> Any:
        self._cache_file.husky_fingerprint = _fingerprint(self._py_func)
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


def _fingerprint(function: FunctionType) -> bytes:
    """Return a digest of the code of a kernel, of all kernels that it calls, and of constants.

    It is the same in each process that has the same sources.
    """
    digest = hashlib.sha256()
    for part in _parts_of(function, set()):
        digest.update(part.encode() + b"\0")
    return digest.digest()


def _parts_of(function: FunctionType, seen: set[int]) -> Iterator[str]:
    """Yield what a compiled function is made of, without the kernels that have been `seen`."""
    seen.add(id(function))
    names: list[str] = []
    codes = [function.__code__]
    for code in codes:
        inner = [each for each in code.co_consts if isinstance(each, CodeType)]
        plain = [each for each in code.co_consts if not isinstance(each, CodeType)]
        yield f"{code.co_code.hex()} {plain} {code.co_names} {code.co_varnames}"
        names += code.co_names
        codes += inner
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    read = [function.__globals__[name] for name in names if name in function.__globals__]
    for value in (*cells, *read, *(function.__defaults__ or ())):
        yield from _parts_of_value(value, names, seen)


def _parts_of_value(value: Any, names: list[str], seen: set[int]) -> Iterator[str]:
    """Yield what compiled code has of a value, or of its attributes that have such names."""
    if isinstance(value, np.ndarray | np.generic):
        yield f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    elif isinstance(value, tuple):
        for each in value:
            yield from _parts_of_value(each, names, seen)
    elif isinstance(value, bool | int | float | complex | str | bytes | np.dtype | None):
        yield repr(value)
    elif isinstance(value, ModuleType | type):
        for name in names:
            if name in vars(value):
                yield name
                others = [each for each in names if each != name]
                yield from _parts_of_value(getattr(value, name), others, seen)
    elif hasattr(value, "py_func"):
        if id(value.py_func) not in seen:
            yield repr(sorted(value.targetoptions.items()))
            yield from _parts_of(value.py_func, seen)
    else:
        yield f"{type(value).__qualname__} {getattr(value, '__qualname__', '')}"

"""Damaged or outdated files in numba's cache: the function is right, and is kept again."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

_MODULE = """
from numba import njit
@njit(cache=True)
def f(x):
    return x * 1.5 + 2.0
"""
_USER = """
import importlib, pathlib, sys
sys.path.insert(0, ".")
import numpy as np, resource
from husky_runtime.numba_cache import seal_numba_cache
import module
seal_numba_cache()
seal_numba_cache()

def use():
    f = importlib.reload(module).f
    assert f(2.0) == 5.0, f(2.0)
    return sum(f.stats.cache_hits.values())

assert use() == 0, "compiled"
assert use() == 1, "found again"
files = sorted(pathlib.Path("cache").rglob("*.nb?"))
assert len(files) == 2
rng = np.random.default_rng(7)
for path in files:
    whole = path.read_bytes()
    cases = [b"", whole[: len(whole) // 2], whole[:-78]]  # the last one without its seal
    for place in rng.integers(0, len(whole), 4):
        cases.append(bytearray(whole))
        cases[-1][place] ^= 1 << rng.integers(8)
    for case, damaged in enumerate(cases):
        path.write_bytes(damaged)
        assert use() == 0, (path, case)
        assert use() == 1, (path, case)
caching = sys.modules["numba.core.caching"].IndexDataCacheFile
load_index = caching._load_index

def load_once(self):
    caching._load_index = load_index
    raise ModuleNotFoundError("No module named 'moved'")

caching._load_index = load_once  # a type in the index is of a module that has moved since
assert use() == 0 and use() == 1
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, -1))
for path in files:
    path.unlink()
assert use() == 0 and use() == 0
print("done")
"""


def test_damaged_functions_are_compiled_anew_not_run(tmp_path: Path) -> None:
    """In a process of its own: numba is changed in it."""
    (tmp_path / "module.py").write_text(_MODULE)
    run = subprocess.run(
        [sys.executable, "-c", _USER],
        cwd=tmp_path,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
    )
    assert run.stdout == "done\n", run.stderr
    assert run.stderr.count("compiled anew") == 15
    assert "not kept: [Errno 27] File too large" in run.stderr


_LOADER = """
import sys
sys.path.insert(0, ".")
import module
from husky_runtime.numba_cache import seal_numba_cache
seal_numba_cache()
assert module.f(2.0) == 5.0
print("numba.np.arraymath" in sys.modules, "scipy.linalg" in sys.modules)
"""


def test_compiled_functions_are_loaded_without_the_compiler(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text(_MODULE)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    loader = [sys.executable, "-c", _LOADER]
    for said in ("True True\n", "False False\n"):
        assert subprocess.check_output(loader, cwd=tmp_path, env=environment, text=True) == said


_CALLED = """
from enum import IntEnum
from numba import njit
OFFSET = 2
class Mode(IntEnum):
    FAST = 3
@njit
def g(x):
    return x * 5
"""
_CALLER = """
from numba import njit
import called
from called import g
@njit(cache=True)
def f(x):
    return g(x) + called.OFFSET + called.Mode.FAST
"""
_CHANGES = """
import importlib, pathlib, sys
sys.path.insert(0, ".")
import called, caller
from husky_runtime.numba_cache import seal_numba_cache
seal_numba_cache()
for text in sys.argv[1:]:
    pathlib.Path("called.py").write_text(text)
    importlib.reload(called)
    f = importlib.reload(caller).f
    print(f(10), sum(f.stats.cache_hits.values()))
"""


def test_functions_are_compiled_anew_when_what_they_call_or_read_has_changed(
    tmp_path: Path,
) -> None:
    (tmp_path / "called.py").write_text(_CALLED)
    (tmp_path / "caller.py").write_text(_CALLER)
    results = {
        _CALLED: "55 0",
        _CALLED.replace("x * 5", "x * 7"): "75 0",
        _CALLED.replace("= 2", "= 4"): "57 0",
        _CALLED.replace("= 3", "= 6"): "58 0",
        _CALLED.replace("= 3", "= 6") + "# the same code": "58 1",
    }
    said = subprocess.check_output(
        [sys.executable, "-B", "-c", _CHANGES, *results],
        cwd=tmp_path,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        text=True,
    )
    assert said.splitlines() == list(results.values())

"""Derivatives as machine code: C from CasADi, compiled once, found again by what it says."""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi as ca

from husky_runtime.stored_file import DamagedFileError, read_sealed, write_sealed

FLAGS = ("-O1", "-fPIC", "-shared")
"""Code without loops, 0.7 MB of it: -O2 takes twice as long, and what comes out is as fast."""

_log = logging.getLogger(__name__)


def cache_directory() -> Path:
    """Where compiled code and plans are kept: $XDG_CACHE_HOME/husky, else ~/.cache/husky."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "husky"


def find_compiler() -> str | None:
    """The C compiler: $CC, gcc or cc; None when there is none."""
    for name in (os.environ.get("CC"), "gcc", "cc"):
        if name and shutil.which(name):
            return shutil.which(name)
    return None


def compile_functions(
    name: str, functions: Sequence[Any], directory: Path | None = None
) -> list[Any]:
    """The same functions as machine code, compiled now or at an earlier time.

    Where nothing can be compiled or kept, the functions come back as they are, interpreted by
    CasADi, which is some times slower; a warning says so.

    Args:
        name: a C identifier, for the file.
        functions: CasADi functions with different names.
        directory: where the library is kept; None for `cache_directory()`.
    """
    compiler = find_compiler()
    if compiler is None:
        _log.warning("no C compiler: derivatives of %s are interpreted, which is slower", name)
        return list(functions)
    source = _generate(name, functions)
    digest = hashlib.sha256("\0".join([source, compiler, *FLAGS]).encode()).hexdigest()[:24]
    library = (directory or cache_directory() / "collocation") / f"{name}-{digest}.so"
    try:
        if not _is_whole(library):
            _compile(compiler, source, library)
        return [ca.external(function.name(), str(library)) for function in functions]
    except (OSError, subprocess.CalledProcessError, RuntimeError) as error:
        detail = getattr(error, "stderr", None) or error
        _log.warning("derivatives of %s are interpreted, which is slower: %s", name, detail)
        return list(functions)


def _generate(name: str, functions: Sequence[Any]) -> str:
    generator = ca.CodeGenerator(name)
    for function in functions:
        generator.add(function)
    return str(generator.dump())


def _is_whole(library: Path) -> bool:
    """Return whether a library is there and is what was compiled: damaged code is never run."""
    try:
        read_sealed(library)
    except FileNotFoundError:
        return False
    except DamagedFileError as error:
        _log.warning("%s; it is compiled anew", error)
        return False
    return True


def _compile(compiler: str, source: str, library: Path) -> None:
    """Compile into a place of its own and move it: another process may do the same.

    The seal stands behind the library, where the loader does not look.
    """
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as scratch:
        code, built = Path(scratch) / "code.c", Path(scratch) / "code.so"
        code.write_text(source, "utf-8")
        subprocess.run(
            [compiler, *FLAGS, str(code), "-o", str(built), "-lm"],
            check=True,
            capture_output=True,
            text=True,
        )
        write_sealed(library, built.read_bytes())

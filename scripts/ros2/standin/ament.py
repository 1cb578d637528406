"""The ament index: which packages and interfaces are installed, and where."""

import os
from pathlib import Path

INDEX = "share/ament_index/resource_index"
KINDS = ("msg", "srv", "action")


def prefixes() -> list[Path]:
    """The install prefixes, the first to be searched first."""
    return [
        Path(prefix)
        for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        if prefix
    ]


def resources(kind: str) -> dict[str, Path]:
    """Files of one kind in the index, by name; what an earlier prefix has hides a later one's."""
    found: dict[str, Path] = {}
    for prefix in prefixes():
        directory = prefix / INDEX / kind
        for path in directory.iterdir() if directory.is_dir() else ():
            if path.is_file() and not path.name.startswith("."):
                found.setdefault(path.name, path)
    return found


def package_prefix(package: str) -> Path | None:
    """The install prefix that holds a package, the first on AMENT_PREFIX_PATH."""
    for prefix in prefixes():
        if (prefix / INDEX / "packages" / package).is_file():
            return prefix
    return None


def executables(package: str) -> list[Path] | None:
    """The executables below lib/<package> of a package's prefix, None when there is no package."""
    prefix = package_prefix(package)
    if prefix is None:
        return None
    base = prefix / "lib" / package
    return [
        path
        for path in sorted(base.rglob("*"))
        if path.is_file()
        and os.access(path, os.X_OK)
        and not any(part.startswith(".") for part in path.parent.relative_to(base).parts)
    ]


def interfaces(package: str) -> list[str]:
    """Interfaces of a package (`msg/Name`, `srv/Name`, `action/Name`), in order, none hidden."""
    index = resources("rosidl_interfaces").get(package)
    lines = index.read_text("utf-8").splitlines() if index else []
    return sorted(
        {
            line.rpartition(".")[0]
            for line in lines
            if "_" not in line and line.partition("/")[0] in KINDS
        }
    )


def interface_file(identifier: str) -> Path:
    """The definition of `package/msg/Name` as its author wrote it, else the IDL made of it.

    Raises ValueError when this is no identifier, LookupError when there is no such interface.
    """
    parts = identifier.split("/")
    if len(parts) != 3:
        raise ValueError(f"Invalid name '{identifier}'. Expected three parts separated by '/'")
    if not all(parts):
        raise ValueError(f"Invalid name '{identifier}'. Must not contain empty parts")
    if ".." in parts:
        raise ValueError(f"Invalid name '{identifier}'. Must not contain '..'")
    package, kind, _ = parts
    prefix = package_prefix(package)
    if prefix is None:
        raise LookupError(f"Unknown package '{package}'")
    path = prefix / "share" / identifier
    for suffix in (kind, "idl"):
        if (file := path.with_name(f"{path.name}.{suffix}")).is_file():
            return file
    raise LookupError(f"Could not find the interface '{path}.idl'")

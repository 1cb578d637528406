"""Where the package's data files are, in a source tree or installed."""

from pathlib import Path


def share_path(relative: str) -> Path:
    """Path of a data file such as `config/carbon.yaml`.

    Raises:
        FileNotFoundError: Neither beside the sources nor in the installed package.
    """
    source = Path(__file__).resolve().parent.parent / relative
    if source.exists():
        return source
    from ament_index_python.packages import get_package_share_directory

    installed = Path(get_package_share_directory("husky_description")) / relative
    if not installed.exists():
        raise FileNotFoundError(f"{relative}: not in {source.parent} nor in {installed.parent}")
    return installed

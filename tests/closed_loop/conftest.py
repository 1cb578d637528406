"""Robots in one process."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # which import mode importlib does not

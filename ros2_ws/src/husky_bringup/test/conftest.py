"""Makes what tests share importable under import mode importlib."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.append(str(Path(__file__).resolve().parents[4] / "tests"))

from bag_fixtures import messages, profiles, typestore, write_bag  # noqa: F401
from console_bench import server  # noqa: F401
from gate_bench import echo, gate_to, heads, pages  # noqa: F401
from replay_bench import record, walk_bag  # noqa: F401

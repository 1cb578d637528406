"""Quality-of-service profiles of the graph, one for each kind of traffic."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

CONTROL = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=16, reliability=ReliabilityPolicy.BEST_EFFORT
)
"""Traffic of every tick: the newest counts, nothing is sent twice. The depth covers a burst."""

STATUS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=10, reliability=ReliabilityPolicy.RELIABLE
)
"""Reports for people and tools at a low rate."""

COMMAND = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=10, reliability=ReliabilityPolicy.RELIABLE
)
"""What an operator or a planner asks for: nothing is lost."""

LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Said once, and told to whoever comes later."""

CLOCK = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT
)
"""`/clock`, as rclpy's own time source subscribes to it."""

PROFILES = {
    "CONTROL": CONTROL,
    "STATUS": STATUS,
    "COMMAND": COMMAND,
    "LATCHED": LATCHED,
    "CLOCK": CLOCK,
}
"""The profiles by the names that `husky_description.graph` uses."""

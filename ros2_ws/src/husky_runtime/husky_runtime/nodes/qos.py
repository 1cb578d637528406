"""Quality-of-service profiles of the graph, one for each kind of traffic.

What the robot's own nodes do not want sent twice is still offered reliably: a subscriber with the
default settings asks for that, and would hear nothing. A writer without such a reader does no more
work than a best-effort one.
"""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

CONTROL = QoSProfile(depth=16, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Traffic of every tick, as it is listened to: the newest counts, nothing is sent twice. The depth
covers a burst."""

CONTROL_OFFERED = QoSProfile(depth=16, reliability=ReliabilityPolicy.RELIABLE)
"""The same as it is published."""

STATUS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
"""Reports for people and tools at a low rate."""

SEQUENCE = QoSProfile(depth=64, reliability=ReliabilityPolicy.RELIABLE)
"""Reports at 50 Hz to a node that is busy for up to a second, and must miss none."""

COMMAND = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
"""What an operator or a planner asks for: nothing is lost."""

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Said once, and told to whoever comes later."""

CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""`/clock`, as rclpy's own time source subscribes to it."""

CLOCK_OFFERED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
"""The same as it is published."""

TF = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""`/tf`, as tf2's own broadcasters offer it."""

PROFILES = {
    "CONTROL": CONTROL,
    "STATUS": STATUS,
    "COMMAND": COMMAND,
    "LATCHED": LATCHED,
    "CLOCK": CLOCK,
    "TF": TF,
}
"""How topics are listened to, by the names that `husky_runtime.graph` uses."""

OFFERED = {**PROFILES, "CONTROL": CONTROL_OFFERED, "CLOCK": CLOCK_OFFERED}
"""How they are published."""

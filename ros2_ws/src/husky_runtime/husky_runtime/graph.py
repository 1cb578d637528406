"""The names of the ROS graph: every topic, service, action and node name is written here, once.

They are relative: ROS puts them below the namespace of the node that uses them, so that there may
be several robots. `absolute` says how a user sees them.
"""

from __future__ import annotations

from dataclasses import dataclass

TICK_PERIOD = 0.002
"""Period of the control tick and of the EtherCAT cycle [s] (thesis T7: 500 Hz)."""
TICK_PERIOD_NS = 2_000_000
"""The same in nanoseconds, the unit of stamps."""
CLOCK_LAG_NS = 50_000_000
"""By how much `/clock`, told 100 times a second, may be behind the stamps of ticks [ns]."""

# Topics
SERVO_STATE = "plant/servo_state"
SERVO_COMMAND = "plant/servo_command"
CYCLE_END = "plant/cycle_end"
"""Only where drives are behind EtherCAT frames: the bridge to the segment, husky_msgs/CycleEnd."""
JOINT_STATES = "joint_states"
JOINT_COMMAND = "joint_command"
DRIVES_STATUS = "drives/status"
IMU = "imu/data"
CMD_VEL = "cmd_vel"
JOY = "joy"
CONTROLLER_STATE = "controller/state"
MODE_TABLE = "controller/modes"
ODOM = "odom"
ODOMETRY = "odometry"
GROUND_TRUTH = "plant/ground_truth"
FOOT_CONTACTS = "plant/foot_contacts"
ESTIMATE_ERROR = "plant/estimate_error"
TERRAIN = "plant/terrain"
FLIGHT_SENSORS = "plant/flight_sensors"
FAN_COMMAND = "plant/fan_command"
FAN_STATE = "plant/fan_state"
PROPULSION_COMMAND = "propulsion/command"
PROPULSION_STATE = "propulsion/state"
BATTERY = "propulsion/battery"
T265_ODOMETRY = "t265/odom"
DEPTH_IMAGE = "camera/camera/depth/image_rect_raw"
DEPTH_CAMERA_INFO = "camera/camera/depth/camera_info"
DEPTH_POINTS = "camera/camera/depth/color/points"
"""Of the depth camera, as realsense-ros names them."""
ELEVATION_MAP = "elevation_map"
OCCUPANCY = "elevation_map/occupancy"
MAP_POSE = "map_pose"
"""Pose of the base in the frame `map`."""
INCLINE_PLAN = "planner/plan"
NAVIGATOR_STATE = "navigator/state"
PLAN = "plan"
ROUTE = "navigator/route"
COST_MAP = "global_costmap/costmap"
GOAL_POSE = "goal_pose"
SIMPLE_GOAL = "move_base_simple/goal"
"""Goals of RViz's "2D Goal Pose" and of Foxglove; the names of plan and cost map are Nav2's."""
ROBOT_DESCRIPTION = "robot_description"
TF = "tf"
TF_STATIC = "tf_static"
MARKERS = "visualization_marker_array"
CLOCK = "clock"
DIAGNOSTICS = "diagnostics"

# Services
DRIVES_ENABLE = "drives/enable"
DRIVES_DISABLE = "drives/disable"
DRIVES_RESET_FAULTS = "drives/reset_faults"
DRIVES_EMERGENCY_STOP = "drives/emergency_stop"
DRIVES_CUT = "drives/cut"
DRIVES_INJECT_FAULT = "drives/inject_fault"
SET_MODE = "controller/set_mode"
SET_GAIT = "controller/set_gait"
PLAN_CYCLE = "planner/plan_cycle"
CLEAR_MAP = "elevation_map/clear"
PROPULSION_ARM = "propulsion/arm"
PROPULSION_SET_MODE = "propulsion/set_mode"
PROPULSION_KILL = "propulsion/kill"
PLANT_RESET = "plant/reset"
PLANT_PAUSE = "plant/pause"
PLANT_STEP = "plant/step"
PLANT_APPLY_WRENCH = "plant/apply_wrench"
PLANT_HOLD = "plant/hold"
PLANT_INJECT_FAULT = "plant/inject_fault"
NAVIGATION_ACTIVE = "lifecycle_manager_navigation/is_active"
LOCALIZATION_ACTIVE = "lifecycle_manager_localization/is_active"
BT_NAVIGATOR_STATE = "bt_navigator/get_state"
"""Services by which Nav2's clients see that a goal may be sent."""

# Actions
PLAN_INCLINE = "planner/plan_incline"
NAVIGATE_TO_POSE = "navigate_to_pose"
NAVIGATE_THROUGH_POSES = "navigate_through_poses"
COMPUTE_PATH = "compute_path_to_pose"
FOLLOW_PATH = "follow_path"
FOLLOW_WAYPOINTS = "follow_waypoints"
"""Nav2's names."""

# Nodes
PLANT = "plant"
DRIVE_BRIDGE = "drive_bridge"
DRIVE_SEGMENT = "drive_segment"
SERVO_BRIDGE = "servo_bridge"
VN200_DRIVER = "vn200_driver"
LOW_LEVEL_CONTROLLER = "low_level_controller"
PLANNER = "planner"
FLIGHT_CONTROLLER = "flight_controller"
PIXHAWK_BRIDGE = "pixhawk_bridge"
RC_TRANSMITTER = "rc_transmitter"
T265_DRIVER = "t265_driver"
D435_DRIVER = "d435_driver"
ELEVATION_MAPPER = "elevation_mapper"
LOCALIZER = "localizer"
NAVIGATOR = "navigator"
RECORDER = "recorder"
TELEOP = "teleop"
FOXGLOVE_GATEWAY = "foxglove_gateway"
CONSOLE = "console"

NODES = (
    PLANT,
    DRIVE_BRIDGE,
    DRIVE_SEGMENT,
    SERVO_BRIDGE,
    VN200_DRIVER,
    LOW_LEVEL_CONTROLLER,
    PLANNER,
    FLIGHT_CONTROLLER,
    PIXHAWK_BRIDGE,
    RC_TRANSMITTER,
    T265_DRIVER,
    D435_DRIVER,
    ELEVATION_MAPPER,
    LOCALIZER,
    NAVIGATOR,
)
"""Those that are the robot: one of each in a domain."""

JOINT_BRIDGES = (DRIVE_BRIDGE, SERVO_BRIDGE)
"""Who speaks to the joints: one of them, as the robot has drives or servos on a bus."""

BUSES = ("sim", "soem")
"""Buses of simulated drives: in the process of `drive_bridge`, or EtherCAT frames on a network
interface, which `drive_segment` answers."""
DRIVE_SIDES = (DRIVE_BRIDGE, DRIVE_SEGMENT)
"""Nodes that speak for the power stages of the drives, one for each bus."""

# What stands in the world
BODIES = ("robot", "robot_with_unit", "unit")
"""Husky without fans, with them, or the propulsion unit alone: parameter `body` of the plant."""

# Frames (REP-105, REP-120); the others are the links of the URDF
FRAME_WORLD = "world"
FRAME_MAP = "map"
FRAME_ODOM = "odom"
FRAME_BASE = "base_link"
FRAME_FOOTPRINT = "base_footprint"
FRAME_IMU = "imu_link"
FRAME_T265 = "t265_link"
FRAME_T265_ODOM = "t265_odom"
FRAME_CAMERA = "camera_link"
FRAME_CAMERA_DEPTH = "camera_depth_frame"
FRAME_CAMERA_OPTICAL = "camera_depth_optical_frame"


@dataclass(frozen=True)
class Topic:
    """One topic of the graph.

    Attributes:
        relative: its name below the robot's namespace.
        type: message type as the `ros2` command writes it.
        publishers: names of the nodes that publish it.
        qos: name of the profile in `husky_runtime.nodes.qos`.
        rate: nominal rate in simulated time [Hz], 0 when it is sent on demand.
    """

    relative: str
    type: str
    publishers: tuple[str, ...]
    qos: str
    rate: float

    @property
    def name(self) -> str:
        """Full name, of a robot that is in no namespace."""
        return absolute(self.relative)


TOPICS = (
    Topic(SERVO_STATE, "husky_msgs/msg/ServoState", (PLANT,), "CONTROL", 500.0),
    Topic(SERVO_COMMAND, "husky_msgs/msg/ServoCommand", DRIVE_SIDES, "CONTROL", 500.0),
    Topic(JOINT_STATES, "sensor_msgs/msg/JointState", JOINT_BRIDGES, "CONTROL", 500.0),
    Topic(JOINT_COMMAND, "husky_msgs/msg/JointCommand", (LOW_LEVEL_CONTROLLER,), "CONTROL", 500.0),
    Topic(DRIVES_STATUS, "husky_msgs/msg/DriveStatusArray", JOINT_BRIDGES, "STATUS", 10.0),
    Topic(IMU, "sensor_msgs/msg/Imu", (VN200_DRIVER,), "CONTROL", 800.0),
    Topic(CMD_VEL, "geometry_msgs/msg/Twist", (TELEOP, CONSOLE, NAVIGATOR), "COMMAND", 0.0),
    Topic(JOY, "sensor_msgs/msg/Joy", (), "COMMAND", 0.0),
    Topic(
        CONTROLLER_STATE,
        "husky_msgs/msg/ControllerState",
        (LOW_LEVEL_CONTROLLER,),
        "STATUS",
        50.0,
    ),
    Topic(MODE_TABLE, "husky_msgs/msg/ModeTable", (LOW_LEVEL_CONTROLLER,), "LATCHED", 0.0),
    Topic(ODOM, "nav_msgs/msg/Odometry", (LOW_LEVEL_CONTROLLER,), "STATUS", 50.0),
    Topic(ODOMETRY, "nav_msgs/msg/Odometry", (LOW_LEVEL_CONTROLLER,), "STATUS", 50.0),
    Topic(GROUND_TRUTH, "nav_msgs/msg/Odometry", (PLANT,), "STATUS", 100.0),
    Topic(FOOT_CONTACTS, "husky_msgs/msg/FootContacts", (PLANT,), "STATUS", 100.0),
    Topic(ESTIMATE_ERROR, "husky_msgs/msg/EstimateError", (PLANT,), "STATUS", 50.0),
    Topic(TERRAIN, "visualization_msgs/msg/MarkerArray", (PLANT,), "LATCHED", 0.0),
    Topic(FLIGHT_SENSORS, "husky_msgs/msg/FlightSensors", (PLANT,), "CONTROL", 500.0),
    Topic(FAN_COMMAND, "husky_msgs/msg/FanCommand", (FLIGHT_CONTROLLER,), "CONTROL", 500.0),
    Topic(FAN_STATE, "husky_msgs/msg/FanState", (PLANT,), "STATUS", 100.0),
    Topic(
        PROPULSION_COMMAND,
        "husky_msgs/msg/PropulsionCommand",
        (LOW_LEVEL_CONTROLLER,),
        "CONTROL",
        100.0,
    ),
    Topic(PROPULSION_STATE, "husky_msgs/msg/PropulsionState", (PIXHAWK_BRIDGE,), "STATUS", 50.0),
    Topic(BATTERY, "sensor_msgs/msg/BatteryState", (PIXHAWK_BRIDGE,), "STATUS", 10.0),
    Topic(T265_ODOMETRY, "nav_msgs/msg/Odometry", (T265_DRIVER,), "CONTROL", 200.0),
    Topic(DEPTH_IMAGE, "sensor_msgs/msg/Image", (D435_DRIVER,), "STATUS", 10.0),
    Topic(DEPTH_CAMERA_INFO, "sensor_msgs/msg/CameraInfo", (D435_DRIVER,), "STATUS", 10.0),
    Topic(DEPTH_POINTS, "sensor_msgs/msg/PointCloud2", (D435_DRIVER,), "STATUS", 0.0),
    Topic(ELEVATION_MAP, "grid_map_msgs/msg/GridMap", (ELEVATION_MAPPER,), "LATCHED", 0.0),
    Topic(OCCUPANCY, "nav_msgs/msg/OccupancyGrid", (ELEVATION_MAPPER,), "LATCHED", 0.0),
    Topic(MAP_POSE, "geometry_msgs/msg/PoseWithCovarianceStamped", (LOCALIZER,), "STATUS", 50.0),
    Topic(INCLINE_PLAN, "husky_msgs/msg/InclinePlan", (PLANNER,), "LATCHED", 0.0),
    Topic(NAVIGATOR_STATE, "husky_msgs/msg/NavigatorState", (NAVIGATOR,), "STATUS", 10.0),
    Topic(PLAN, "nav_msgs/msg/Path", (NAVIGATOR,), "LATCHED", 0.0),
    Topic(ROUTE, "visualization_msgs/msg/MarkerArray", (NAVIGATOR,), "LATCHED", 0.0),
    Topic(COST_MAP, "nav_msgs/msg/OccupancyGrid", (NAVIGATOR,), "LATCHED", 0.0),
    Topic(GOAL_POSE, "geometry_msgs/msg/PoseStamped", (CONSOLE,), "COMMAND", 0.0),
    Topic(SIMPLE_GOAL, "geometry_msgs/msg/PoseStamped", (), "COMMAND", 0.0),
    Topic(ROBOT_DESCRIPTION, "std_msgs/msg/String", JOINT_BRIDGES, "LATCHED", 0.0),
    Topic(
        TF,
        "tf2_msgs/msg/TFMessage",
        (PLANT, *JOINT_BRIDGES, LOW_LEVEL_CONTROLLER, T265_DRIVER, LOCALIZER),
        "TF",
        0.0,
    ),
    Topic(
        TF_STATIC,
        "tf2_msgs/msg/TFMessage",
        (*JOINT_BRIDGES, T265_DRIVER, D435_DRIVER),
        "LATCHED",
        0.0,
    ),
    Topic(
        MARKERS,
        "visualization_msgs/msg/MarkerArray",
        (LOW_LEVEL_CONTROLLER, PLANNER, PIXHAWK_BRIDGE),
        "STATUS",
        0.0,
    ),
    Topic(CLOCK, "rosgraph_msgs/msg/Clock", (PLANT,), "CLOCK", 100.0),
    Topic(
        DIAGNOSTICS,
        "diagnostic_msgs/msg/DiagnosticArray",
        (*NODES, RECORDER, FOXGLOVE_GATEWAY, CONSOLE),
        "STATUS",
        1.0,
    ),
)
"""Every topic of the graph; those of the propulsion unit and of the depth camera are there when it
is."""


def absolute(name: str, namespace: str = "/") -> str:
    """Return the full name of a topic, service or action; one that is full stays as it is."""
    return name if name.startswith("/") else f"{namespace.rstrip('/')}/{name}"


def topic(name: str) -> Topic:
    """Return the row of a topic by its name here, or its full name; raises KeyError for none."""
    for row in TOPICS:
        if row.name == absolute(name):
            return row
    raise KeyError(f"no topic {name!r} in the graph; there are {[row.name for row in TOPICS]}")


def serial_port(device: str, domain_id: int, namespace: str = "/") -> str:
    """Return the path where a simulated serial device appears, one per robot.

    Args:
        device: e.g. "vn200".
        domain_id: ROS_DOMAIN_ID, so that two graphs on one machine stay apart.
        namespace: of the robot, so that two robots in one graph do.
    """
    return f"/tmp/husky-{domain_id}{dotted(namespace)}/{device}"


def dotted(namespace: str) -> str:
    """Return a namespace as part of a file's name: "" for the root, else e.g. ".robot1"."""
    return namespace.rstrip("/").replace("/", ".")

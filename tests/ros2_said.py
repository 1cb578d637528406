"""What `ros2` says of the sample node (tests/fixtures/sample_node.py), as ros2cli 0.32 does."""

JOINTS = """\
header:
  stamp:
    sec: 0
    nanosec: 0
  frame_id: base
name:
- knee
- hip
position:
- 0.5
- -1.0
velocity:
- 0.0
- 0.0
- 0.0
effort: []
---
"""

OUTPUTS = {
    "topic type /joints": "sensor_msgs/msg/JointState\n",
    "topic info /mixed": ("Type: std_msgs/msg/String\nPublisher count: 2\nSubscription count: 0\n"),
    "topic echo /joints --once": JOINTS,
    "topic echo /joints sensor_msgs/JointState --once": JOINTS,
    "topic echo /joints --once --csv": "0,0,base,knee,hip,0.5,-1.0,0.0,0.0,0.0,\n",
    "topic echo /joints --once --no-arr --field header": (
        "stamp:\n  sec: 0\n  nanosec: 0\nframe_id: base\n---\n"
    ),
    "topic echo /joints --once --field position": "array('d', [0.5, -1.0])\n---\n",
    "topic echo /joints --once --field header.frame_id": "base\n---\n",
    "topic echo /joints --once --filter len(m)==2 --field name": "['knee', 'hip']\n---\n",
    "topic echo /text --once --truncate-length 3": "data: xxx...\n---\n",
    "topic echo /latched --once": "data: once\n---\n",
    "topic echo /latched --timeout 0.5 --qos-durability volatile": "",
    "topic echo /mixture --once --filter m.data=='best-effort'": (
        "Some, but not all, publishers are offering QoSReliabilityPolicy.RELIABLE. Falling back to "
        "QoSReliabilityPolicy.BEST_EFFORT as it will connect to all publishers\n"
        "data: best-effort\n---\n"
    ),
    "topic find geometry_msgs/msg/TwistStamped": "/command\n/received\n",
    "service find std_srvs/srv/Trigger -c": "1\n",
    "service info /trigger": "Type: std_srvs/srv/Trigger\nClients count: 0\nServices count: 1\n",
    "action list -t": "/plan [husky_msgs/action/PlanIncline]\n",
    "action type /plan": "husky_msgs/action/PlanIncline\n",
    "action info /plan": (
        "Action: /plan\nAction clients: 1\n    /sample\nAction servers: 1\n    /sample\n"
    ),
    "action info plan -c": "Action: plan\nAction clients: 1\nAction servers: 1\n",
    "interface show std_srvs/srv/SetBool": (
        "bool data # e.g. for hardware enabling / disabling\n---\n"
        "bool success   # indicate successful run of triggered service\n"
        "string message # informational, e.g. for error messages\n"
    ),
    "interface show --no-comments geometry_msgs/msg/TwistStamped": (
        "std_msgs/Header header\n\tbuiltin_interfaces/Time stamp\n\t\tint32 sec\n"
        "\t\tuint32 nanosec\n\tstring frame_id\nTwist twist\n\tVector3  linear\n"
        "\t\tfloat64 x\n\t\tfloat64 y\n\t\tfloat64 z\n\tVector3  angular\n"
        "\t\tfloat64 x\n\t\tfloat64 y\n\t\tfloat64 z\n"
    ),
    "interface proto geometry_msgs/msg/Point": '"x: 0.0\ny: 0.0\nz: 0.0\n"\n',
    "interface proto --no-quotes std_srvs/srv/SetBool": "data: false\n\n",
    "interface package husky_msgs -a": "husky_msgs/action/PlanIncline\n",
    "pkg xml std_srvs -t license": "Apache License 2.0\n",
    "node list": "/arm/device\n/sample\n",
    "node list -c": "2\n",
    "param get /sample gains.kp": "Double value is: 300.0\n",
    "param get sample gains.legs": "Double values are: [1.0, 2.5]\n",
    "param get /sample enabled": "Boolean value is: True\n",
    "param get /sample names --hide-type": "['a', 'b']\n",
    "param dump /arm/device": (
        "/arm/device:\n  ros__parameters:\n    start_type_description_service: true\n"
        "    use_sim_time: false\n\n"
    ),
    "param describe /sample gains.kp": (
        "Parameter name: gains.kp\n  Type: double\n  Description: position gain, N m/rad\n"
        "  Constraints:\n    Min value: 0.0\n    Max value: 500.0\n"
    ),
    "param list /sample --filter gains": "  gains.kp\n  gains.legs\n",
    "lifecycle nodes": "/arm/device\n",
    "lifecycle get": "/arm/device: unconfigured [1]\n",
    "lifecycle get /arm/device": "unconfigured [1]\n",
    "lifecycle list /arm/device": (
        "- configure [1]\n\tStart: unconfigured\n\tGoal: configuring\n"
        "- shutdown [5]\n\tStart: unconfigured\n\tGoal: shuttingdown\n"
    ),
}

ERRORS = {
    "topic info /nothing": "Unknown topic '/nothing'\n",
    "topic echo /nothing --once": "Could not determine the type for the passed topic\n",
    "topic echo /joints nope/msg/JointState": "The passed message type is invalid\n",
    "topic echo /joints --once --field nope": (
        "Invalid field 'nope': 'JointState' object has no attribute 'nope'\n"
    ),
    "service info /nope": "Unknown service '/nope'\n",
    "action type /nope": "",
    "interface show husky_msgs/Nope": (
        "Invalid name 'husky_msgs/Nope'. Expected three parts separated by '/'\n"
    ),
    "interface show nope/msg/Nope": "Unknown package 'nope'\n",
    "interface package nope": "Unknown package 'nope'\n",
    "pkg prefix nope": "Package not found\n",
    "pkg executables nope": "Package 'nope' not found\n",
    "pkg xml std_srvs -t nope": "XML tag not found\n",
    "node info /nope": "Unable to find node '/nope'\n",
    "param get /sample nope": "Parameter not set\n",
    "param get /nope count": "Node not found\n",
    "lifecycle get /sample": "Node not found\n",
    "lifecycle set /arm/device activate": (
        "Unknown transition requested, available ones are:\n- configure [1]\n- shutdown [5]\n"
    ),
}

LISTS = (  # what they print is looked at in parts
    "topic list -t",
    "topic list -v",
    "topic list --include-hidden-topics",
    "topic info -v /joints",
    "node info /sample",
    "service list -t",
    "service list -c",
    "interface packages -a",
    "doctor -ep -iw",
    "doctor -r -ep",
)

CALLS = {  # command: exit code, a line of stdout, stderr
    "topic pub -1 -w 0 /nobody geometry_msgs/Vector3Stamped {nope: 1}": (
        1,
        "",
        "Failed to populate field: 'Vector3Stamped' object has no attribute 'nope'\n",
    ),
    "topic pub -1 -w 0 /nobody std_msgs/String hello": (
        1,
        "",
        "The passed value needs to be a dictionary in YAML format\n",
    ),
    "topic pub -1 -w 0 /nobody nope {}": (1, "", "The passed message type is invalid\n"),
    "topic pub -1 /nobody std_msgs/String --max-wait-time-secs 0.1": (
        1,
        "Waiting for at least 1 matching subscription(s)...\n",
        "Timed out waiting for subscribers: Expected 1 subcribers but only got 0 subscribers\n",
    ),
    "topic pub -1 -w 0 /nobody sensor_msgs/msg/JointState {position: [1, 2.5]}": (
        0,
        "publisher: beginning loop\npublishing #1: sensor_msgs.msg.JointState(header="
        "std_msgs.msg.Header(stamp=builtin_interfaces.msg.Time(sec=0, nanosec=0), frame_id=''), "
        "name=[], position=[1.0, 2.5], velocity=[], effort=[])\n\n",
        "",
    ),
    "service call /set_bool std_srvs/srv/SetBool {data: true}": (
        0,
        "requester: making request: std_srvs.srv.SetBool_Request(data=True)\n\nresponse:\n"
        "std_srvs.srv.SetBool_Response(success=True, message='was True')\n\n",
        "",
    ),
    "service call /trigger std_srvs/srv/Nope": (1, "", "The passed service type is invalid\n"),
    "service call /set_bool std_srvs/srv/SetBool {nope: 1}": (
        1,
        "",
        "Failed to populate field: 'SetBool_Request' object has no attribute 'nope'\n",
    ),
    "action send_goal /plan std_srvs/srv/SetBool": (1, "", "The passed action type is invalid\n"),
    "run nope nope": (1, "", "Package 'nope' not found\n"),
    "run husky_msgs nope": (1, "", "No executable found\n"),
}

REFUSED = """\
Waiting for an action server to become available...
Sending goal:
     slope: 0.0
speed: -1.0
friction: 0.0
friction_margin: 0.0
thrust_mode: ''
gait: ''
thrust_limit: 0.0

Goal was rejected.
"""

GOALS = {  # each makes a client of its own, which `action info` counts: code, stdout, stderr
    "{speed: -1}": (0, REFUSED, ""),
    "{nope: 1}": (
        1,
        "",
        "Failed to populate message fields: "
        "AttributeError(\"'PlanIncline_Goal' object has no attribute 'nope'\")\n",
    ),
}

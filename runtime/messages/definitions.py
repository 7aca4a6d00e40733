"""The definitions of ROS 2's messages that bus, node and exports use.

Source: the .msg, .srv and .action files of ROS 2's interface packages, and control_msgs of ros2_control.
"""

from __future__ import annotations

from typing import Final

FOLLOW: Final = "control_msgs/action/FollowJointTrajectory"
INDEXED: Final = "@kilted"  # since Kilted the action's feedback has two fields more, under the same name

_XYZ = (("x", "float64"), ("y", "float64"), ("z", "float64"))
_HEADER = ("header", "std_msgs/msg/Header")
_GOAL_ID = ("goal_id", "unique_identifier_msgs/msg/UUID")
_TOLERANCES = (("position", "float64"), ("velocity", "float64"), ("acceleration", "float64"))
_POINTS = ("desired", "actual", "error")
_JOINTS = (
    _HEADER,
    ("joint_names", "string[]"),
    *((name, "trajectory_msgs/msg/JointTrajectoryPoint") for name in _POINTS),
)
_MULTI_DOF = (
    ("multi_dof_joint_names", "string[]"),
    *((f"multi_dof_{name}", "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint") for name in _POINTS),
)

# Message definitions: (field, type). A type ends in [] for a sequence, in [n] for an array.
TYPES: dict[str, tuple[tuple[str, str], ...]] = {
    "builtin_interfaces/msg/Time": (("sec", "int32"), ("nanosec", "uint32")),
    "builtin_interfaces/msg/Duration": (("sec", "int32"), ("nanosec", "uint32")),
    "std_msgs/msg/Header": (("stamp", "builtin_interfaces/msg/Time"), ("frame_id", "string")),
    "std_msgs/msg/Bool": (("data", "bool"),),
    "std_msgs/msg/String": (("data", "string"),),
    "std_msgs/msg/MultiArrayDimension": (("label", "string"), ("size", "uint32"), ("stride", "uint32")),
    "std_msgs/msg/MultiArrayLayout": (
        ("dim", "std_msgs/msg/MultiArrayDimension[]"),
        ("data_offset", "uint32"),
    ),
    "std_msgs/msg/Int64MultiArray": (("layout", "std_msgs/msg/MultiArrayLayout"), ("data", "int64[]")),
    "std_msgs/msg/Float64MultiArray": (("layout", "std_msgs/msg/MultiArrayLayout"), ("data", "float64[]")),
    "geometry_msgs/msg/Point": _XYZ,
    "geometry_msgs/msg/Vector3": _XYZ,
    "geometry_msgs/msg/Quaternion": (*_XYZ, ("w", "float64")),
    "geometry_msgs/msg/Pose": (
        ("position", "geometry_msgs/msg/Point"),
        ("orientation", "geometry_msgs/msg/Quaternion"),
    ),
    "geometry_msgs/msg/Twist": (
        ("linear", "geometry_msgs/msg/Vector3"),
        ("angular", "geometry_msgs/msg/Vector3"),
    ),
    "geometry_msgs/msg/Wrench": (
        ("force", "geometry_msgs/msg/Vector3"),
        ("torque", "geometry_msgs/msg/Vector3"),
    ),
    "geometry_msgs/msg/PointStamped": (_HEADER, ("point", "geometry_msgs/msg/Point")),
    "geometry_msgs/msg/PoseStamped": (_HEADER, ("pose", "geometry_msgs/msg/Pose")),
    "geometry_msgs/msg/TwistStamped": (_HEADER, ("twist", "geometry_msgs/msg/Twist")),
    "geometry_msgs/msg/WrenchStamped": (_HEADER, ("wrench", "geometry_msgs/msg/Wrench")),
    "geometry_msgs/msg/PoseWithCovariance": (
        ("pose", "geometry_msgs/msg/Pose"),
        ("covariance", "float64[36]"),
    ),
    "geometry_msgs/msg/TwistWithCovariance": (
        ("twist", "geometry_msgs/msg/Twist"),
        ("covariance", "float64[36]"),
    ),
    "geometry_msgs/msg/Transform": (
        ("translation", "geometry_msgs/msg/Vector3"),
        ("rotation", "geometry_msgs/msg/Quaternion"),
    ),
    "geometry_msgs/msg/TransformStamped": (
        _HEADER,
        ("child_frame_id", "string"),
        ("transform", "geometry_msgs/msg/Transform"),
    ),
    "std_srvs/srv/Trigger_Response": (("success", "bool"), ("message", "string")),
    "tf2_msgs/msg/TFMessage": (("transforms", "geometry_msgs/msg/TransformStamped[]"),),
    "rcl_interfaces/msg/Log": (
        ("stamp", "builtin_interfaces/msg/Time"),
        ("level", "uint8"),
        ("name", "string"),
        ("msg", "string"),
        ("file", "string"),
        ("function", "string"),
        ("line", "uint32"),
    ),
    "nav_msgs/msg/Odometry": (
        _HEADER,
        ("child_frame_id", "string"),
        ("pose", "geometry_msgs/msg/PoseWithCovariance"),
        ("twist", "geometry_msgs/msg/TwistWithCovariance"),
    ),
    "sensor_msgs/msg/JointState": (
        _HEADER,
        ("name", "string[]"),
        ("position", "float64[]"),
        ("velocity", "float64[]"),
        ("effort", "float64[]"),
    ),
    "trajectory_msgs/msg/JointTrajectoryPoint": (
        ("positions", "float64[]"),
        ("velocities", "float64[]"),
        ("accelerations", "float64[]"),
        ("effort", "float64[]"),
        ("time_from_start", "builtin_interfaces/msg/Duration"),
    ),
    "trajectory_msgs/msg/JointTrajectory": (
        _HEADER,
        ("joint_names", "string[]"),
        ("points", "trajectory_msgs/msg/JointTrajectoryPoint[]"),
    ),
    "sensor_msgs/msg/Joy": (_HEADER, ("axes", "float32[]"), ("buttons", "int32[]")),
    "diagnostic_msgs/msg/KeyValue": (("key", "string"), ("value", "string")),
    "diagnostic_msgs/msg/DiagnosticStatus": (
        ("level", "uint8"),
        ("name", "string"),
        ("message", "string"),
        ("hardware_id", "string"),
        ("values", "diagnostic_msgs/msg/KeyValue[]"),
    ),
    "diagnostic_msgs/msg/DiagnosticArray": (_HEADER, ("status", "diagnostic_msgs/msg/DiagnosticStatus[]")),
    "unique_identifier_msgs/msg/UUID": (("uuid", "uint8[16]"),),
    "action_msgs/msg/GoalInfo": (_GOAL_ID, ("stamp", "builtin_interfaces/msg/Time")),
    "action_msgs/msg/GoalStatus": (("goal_info", "action_msgs/msg/GoalInfo"), ("status", "int8")),
    "action_msgs/msg/GoalStatusArray": (("status_list", "action_msgs/msg/GoalStatus[]"),),
    "action_msgs/srv/CancelGoal_Request": (("goal_info", "action_msgs/msg/GoalInfo"),),
    "action_msgs/srv/CancelGoal_Response": (
        ("return_code", "int8"),
        ("goals_canceling", "action_msgs/msg/GoalInfo[]"),
    ),
    "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint": (
        ("transforms", "geometry_msgs/msg/Transform[]"),
        ("velocities", "geometry_msgs/msg/Twist[]"),
        ("accelerations", "geometry_msgs/msg/Twist[]"),
        ("time_from_start", "builtin_interfaces/msg/Duration"),
    ),
    "trajectory_msgs/msg/MultiDOFJointTrajectory": (
        _HEADER,
        ("joint_names", "string[]"),
        ("points", "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint[]"),
    ),
    "control_msgs/msg/JointTolerance": (("name", "string"), *_TOLERANCES),
    "control_msgs/msg/JointComponentTolerance": (("joint_name", "string"), ("component", "uint16"), *_TOLERANCES),
    f"{FOLLOW}_Goal": (
        ("trajectory", "trajectory_msgs/msg/JointTrajectory"),
        ("multi_dof_trajectory", "trajectory_msgs/msg/MultiDOFJointTrajectory"),
        ("path_tolerance", "control_msgs/msg/JointTolerance[]"),
        ("component_path_tolerance", "control_msgs/msg/JointComponentTolerance[]"),
        ("goal_tolerance", "control_msgs/msg/JointTolerance[]"),
        ("component_goal_tolerance", "control_msgs/msg/JointComponentTolerance[]"),
        ("goal_time_tolerance", "builtin_interfaces/msg/Duration"),
    ),
    f"{FOLLOW}_Result": (("error_code", "int32"), ("error_string", "string")),
    f"{FOLLOW}_Feedback": (*_JOINTS, *_MULTI_DOF),
    f"{FOLLOW}_SendGoal_Request": (_GOAL_ID, ("goal", f"{FOLLOW}_Goal")),
    f"{FOLLOW}_SendGoal_Response": (("accepted", "bool"), ("stamp", "builtin_interfaces/msg/Time")),
    f"{FOLLOW}_GetResult_Request": (_GOAL_ID,),
    f"{FOLLOW}_GetResult_Response": (("status", "int8"), ("result", f"{FOLLOW}_Result")),
    f"{FOLLOW}_FeedbackMessage": (_GOAL_ID, ("feedback", f"{FOLLOW}_Feedback")),
    f"{FOLLOW}_Feedback{INDEXED}": (*_JOINTS, ("index", "int32"), *_MULTI_DOF, ("multi_dof_index", "int32")),
    f"{FOLLOW}_FeedbackMessage{INDEXED}": (_GOAL_ID, ("feedback", f"{FOLLOW}_Feedback{INDEXED}")),
    "rcl_interfaces/msg/ParameterValue": (
        ("type", "uint8"),
        ("bool_value", "bool"),
        ("integer_value", "int64"),
        ("double_value", "float64"),
        ("string_value", "string"),
        ("byte_array_value", "uint8[]"),
        ("bool_array_value", "bool[]"),
        ("integer_array_value", "int64[]"),
        ("double_array_value", "float64[]"),
        ("string_array_value", "string[]"),
    ),
    "rcl_interfaces/msg/Parameter": (("name", "string"), ("value", "rcl_interfaces/msg/ParameterValue")),
    "rcl_interfaces/msg/FloatingPointRange": (
        ("from_value", "float64"),
        ("to_value", "float64"),
        ("step", "float64"),
    ),
    "rcl_interfaces/msg/IntegerRange": (("from_value", "int64"), ("to_value", "int64"), ("step", "uint64")),
    "rcl_interfaces/msg/ParameterDescriptor": (
        ("name", "string"),
        ("type", "uint8"),
        ("description", "string"),
        ("additional_constraints", "string"),
        ("read_only", "bool"),
        ("dynamic_typing", "bool"),
        ("floating_point_range", "rcl_interfaces/msg/FloatingPointRange[]"),
        ("integer_range", "rcl_interfaces/msg/IntegerRange[]"),
    ),
    "rcl_interfaces/msg/SetParametersResult": (("successful", "bool"), ("reason", "string")),
    "rcl_interfaces/msg/ListParametersResult": (("names", "string[]"), ("prefixes", "string[]")),
    "rcl_interfaces/srv/GetParameters_Request": (("names", "string[]"),),
    "rcl_interfaces/srv/GetParameters_Response": (("values", "rcl_interfaces/msg/ParameterValue[]"),),
    "rcl_interfaces/srv/GetParameterTypes_Request": (("names", "string[]"),),
    "rcl_interfaces/srv/GetParameterTypes_Response": (("types", "uint8[]"),),
    "rcl_interfaces/srv/DescribeParameters_Request": (("names", "string[]"),),
    "rcl_interfaces/srv/DescribeParameters_Response": (("descriptors", "rcl_interfaces/msg/ParameterDescriptor[]"),),
    "rcl_interfaces/srv/ListParameters_Request": (("prefixes", "string[]"), ("depth", "uint64")),
    "rcl_interfaces/srv/ListParameters_Response": (("result", "rcl_interfaces/msg/ListParametersResult"),),
    "rcl_interfaces/srv/SetParameters_Request": (("parameters", "rcl_interfaces/msg/Parameter[]"),),
    "rcl_interfaces/srv/SetParameters_Response": (("results", "rcl_interfaces/msg/SetParametersResult[]"),),
    "rcl_interfaces/srv/SetParametersAtomically_Request": (("parameters", "rcl_interfaces/msg/Parameter[]"),),
    "rcl_interfaces/srv/SetParametersAtomically_Response": (("result", "rcl_interfaces/msg/SetParametersResult"),),
    "std_msgs/msg/ColorRGBA": (("r", "float32"), ("g", "float32"), ("b", "float32"), ("a", "float32")),
    "sensor_msgs/msg/CompressedImage": (_HEADER, ("format", "string"), ("data", "uint8[]")),
    "visualization_msgs/msg/MeshFile": (("filename", "string"), ("data", "uint8[]")),
    "visualization_msgs/msg/UVCoordinate": (("u", "float32"), ("v", "float32")),
    "visualization_msgs/msg/Marker": (
        _HEADER,
        ("ns", "string"),
        ("id", "int32"),
        ("type", "int32"),
        ("action", "int32"),
        ("pose", "geometry_msgs/msg/Pose"),
        ("scale", "geometry_msgs/msg/Vector3"),
        ("color", "std_msgs/msg/ColorRGBA"),
        ("lifetime", "builtin_interfaces/msg/Duration"),
        ("frame_locked", "bool"),
        ("points", "geometry_msgs/msg/Point[]"),
        ("colors", "std_msgs/msg/ColorRGBA[]"),
        ("texture_resource", "string"),
        ("texture", "sensor_msgs/msg/CompressedImage"),
        ("uv_coordinates", "visualization_msgs/msg/UVCoordinate[]"),
        ("text", "string"),
        ("mesh_resource", "string"),
        ("mesh_file", "visualization_msgs/msg/MeshFile"),
        ("mesh_use_embedded_materials", "bool"),
    ),  # since Humble
    "visualization_msgs/msg/MarkerArray": (("markers", "visualization_msgs/msg/Marker[]"),),
}

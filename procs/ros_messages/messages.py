"""ROS 2 messages as plain DDS structures without keys, in the order and with the names of their packages.

Only those used by the bridge. `ros_name` and `type_hash` (hashes.py) are derived from these classes, so that a message
is defined once.
"""

from dataclasses import dataclass, field

from trocar.procs.ros_messages.idl import (
    IdlStruct,
    Name,
    Octets,
    float32,
    float64,
    int32,
    int64,
    sequence,
    uint8,
    uint32,
)

# No postponed annotations: cyclonedds evaluates the types when a class is made.


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    """Time of day since 1970 UTC, or simulated time."""

    sec: int32 = 0
    nanosec: uint32 = 0

@dataclass
class MessageHeader(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    """Time and frame; a stamp of 0 marks the rest as invalid."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""

@dataclass
class Bool(IdlStruct, typename="std_msgs.msg.dds_.Bool_"):
    """On or off."""

    data: bool = False

@dataclass
class String(IdlStruct, typename="std_msgs.msg.dds_.String_"):
    """A text."""

    data: str = ""

@dataclass
class Float64(IdlStruct, typename="std_msgs.msg.dds_.Float64_"):
    """A number."""

    data: float64 = 0.0

@dataclass
class Empty(IdlStruct, typename="std_msgs.msg.dds_.Empty_"):
    """Nothing; DDS knows no structure without a member."""

    structure_needs_at_least_one_member: uint8 = 0

@dataclass
class MultiArrayDimension(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayDimension_"):
    """One dimension of an array."""

    label: str = ""
    size: uint32 = 0
    stride: uint32 = 0

@dataclass
class MultiArrayLayout(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayLayout_"):
    """Dimensions, outermost first."""

    dim: sequence[MultiArrayDimension] = field(default_factory=list)
    data_offset: uint32 = 0

@dataclass
class Float64MultiArray(IdlStruct, typename="std_msgs.msg.dds_.Float64MultiArray_"):
    """Numbers, row by row."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: sequence[float64] = field(default_factory=list)

@dataclass
class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    """A vector, in the units of its message."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0

@dataclass
class Point(IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
    """A place, m."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0

@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    """An orientation."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0

@dataclass
class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    """Place and orientation."""

    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)

@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs.msg.dds_.PoseStamped_"):
    """A pose in a frame."""

    header: MessageHeader = field(default_factory=MessageHeader)
    pose: Pose = field(default_factory=Pose)

@dataclass
class Twist(IdlStruct, typename="geometry_msgs.msg.dds_.Twist_"):
    """Velocities, m/s and rad/s."""

    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)

@dataclass
class TwistStamped(IdlStruct, typename="geometry_msgs.msg.dds_.TwistStamped_"):
    """A twist in a frame."""

    header: MessageHeader = field(default_factory=MessageHeader)
    twist: Twist = field(default_factory=Twist)

@dataclass
class Wrench(IdlStruct, typename="geometry_msgs.msg.dds_.Wrench_"):
    """Force and torque, N and N·m."""

    force: Vector3 = field(default_factory=Vector3)
    torque: Vector3 = field(default_factory=Vector3)

@dataclass
class WrenchStamped(IdlStruct, typename="geometry_msgs.msg.dds_.WrenchStamped_"):
    """A wrench in a frame."""

    header: MessageHeader = field(default_factory=MessageHeader)
    wrench: Wrench = field(default_factory=Wrench)

@dataclass
class QuaternionStamped(IdlStruct, typename="geometry_msgs.msg.dds_.QuaternionStamped_"):
    """An orientation in a frame."""

    header: MessageHeader = field(default_factory=MessageHeader)
    quaternion: Quaternion = field(default_factory=Quaternion)

@dataclass
class Transform(IdlStruct, typename="geometry_msgs.msg.dds_.Transform_"):
    """Pose of a frame in another one."""

    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)

@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs.msg.dds_.TransformStamped_"):
    """The same, with the names of both."""

    header: MessageHeader = field(default_factory=MessageHeader)
    child_frame_id: str = ""
    transform: Transform = field(default_factory=Transform)

@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs.msg.dds_.TFMessage_"):
    """Several of them."""

    transforms: sequence[TransformStamped] = field(default_factory=list)

@dataclass
class JointStates(IdlStruct, typename="sensor_msgs.msg.dds_.JointState_"):
    """Joints: rad and m, their rates and efforts; any part may be empty."""

    header: MessageHeader = field(default_factory=MessageHeader)
    name: sequence[str] = field(default_factory=list)
    position: sequence[float64] = field(default_factory=list)
    velocity: sequence[float64] = field(default_factory=list)
    effort: sequence[float64] = field(default_factory=list)

@dataclass
class Joy(IdlStruct, typename="sensor_msgs.msg.dds_.Joy_"):
    """Buttons: 0 released, 1 pressed, 2 clicked."""

    header: MessageHeader = field(default_factory=MessageHeader)
    axes: sequence[float32] = field(default_factory=list)
    buttons: sequence[int32] = field(default_factory=list)

@dataclass
class Clock(IdlStruct, typename="rosgraph_msgs.msg.dds_.Clock_"):
    """Simulated time."""

    clock: Time = field(default_factory=Time)

@dataclass
class Log(IdlStruct, typename="rcl_interfaces.msg.dds_.Log_"):
    """A line of /rosout."""

    stamp: Time = field(default_factory=Time)
    level: uint8 = 0
    name: str = ""
    msg: str = ""
    file: str = ""
    function: str = ""
    line: uint32 = 0

@dataclass
class OperatingState(IdlStruct, typename="crtk_msgs.msg.dds_.OperatingState_"):
    """The operating state of an arm."""

    header: MessageHeader = field(default_factory=MessageHeader)
    state: str = ""
    is_homed: bool = False
    is_busy: bool = False

@dataclass
class StringStamped(IdlStruct, typename="crtk_msgs.msg.dds_.StringStamped_"):
    """A text with its time."""

    header: MessageHeader = field(default_factory=MessageHeader)
    string: str = ""

@dataclass
class CartesianState(IdlStruct, typename="crtk_msgs.msg.dds_.CartesianState_"):
    """Pose, twist and wrench, and which of them are meant."""

    header: MessageHeader = field(default_factory=MessageHeader)
    pose: Pose = field(default_factory=Pose)
    pose_is_valid: Bool = field(default_factory=Bool)
    twist: Twist = field(default_factory=Twist)
    twist_is_valid: Bool = field(default_factory=Bool)
    wrench: Wrench = field(default_factory=Wrench)
    wrench_is_valid: Bool = field(default_factory=Bool)

@dataclass
class CartesianImpedanceHalfPlaneGains(IdlStruct, typename="crtk_msgs.msg.dds_.CartesianImpedanceHalfPlaneGains_"):
    """Stiffness, damping, bias and dead-band on one side, for each axis."""

    p: Vector3 = field(default_factory=Vector3)
    d: Vector3 = field(default_factory=Vector3)
    bias: Vector3 = field(default_factory=Vector3)
    deadband: Vector3 = field(default_factory=Vector3)

@dataclass
class CartesianImpedance(IdlStruct, typename="crtk_msgs.msg.dds_.CartesianImpedance_"):
    """Springs and dampers about a place and an orientation."""

    header: MessageHeader = field(default_factory=MessageHeader)
    force_orientation: Quaternion = field(default_factory=Quaternion)
    force_position: Vector3 = field(default_factory=Vector3)
    torque_orientation: Quaternion = field(default_factory=Quaternion)
    position_positive: CartesianImpedanceHalfPlaneGains = field(default_factory=CartesianImpedanceHalfPlaneGains)
    position_negative: CartesianImpedanceHalfPlaneGains = field(default_factory=CartesianImpedanceHalfPlaneGains)
    orientation_positive: CartesianImpedanceHalfPlaneGains = field(default_factory=CartesianImpedanceHalfPlaneGains)
    orientation_negative: CartesianImpedanceHalfPlaneGains = field(default_factory=CartesianImpedanceHalfPlaneGains)

@dataclass
class IntervalStatistics(IdlStruct, typename="cisst_msgs.msg.dds_.IntervalStatistics_"):
    """Statistics of a loop in an interval; times in s."""

    header: MessageHeader = field(default_factory=MessageHeader)
    period_avg: float64 = 0.0
    period_std_dev: float64 = 0.0
    period_min: float64 = 0.0
    period_max: float64 = 0.0
    compute_time_avg: float64 = 0.0
    compute_time_std_dev: float64 = 0.0
    compute_time_min: float64 = 0.0
    compute_time_max: float64 = 0.0
    number_of_samples: int64 = 0
    number_of_overruns: int64 = 0
    statistics_interval: float64 = 0.0
    user_data: int64 = 0

@dataclass
class Gid(IdlStruct, typename="rmw_dds_common.msg.dds_.Gid_"):
    """DDS identifier of an endpoint: 16 bytes."""

    data: Octets = bytes(16)

@dataclass
class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common.msg.dds_.NodeEntitiesInfo_"):
    """The endpoints of a node."""

    node_namespace: Name = ""
    node_name: Name = ""
    reader_gid_seq: sequence[Gid] = field(default_factory=list)
    writer_gid_seq: sequence[Gid] = field(default_factory=list)

@dataclass
class ParticipantEntitiesInfo(IdlStruct, typename="rmw_dds_common.msg.dds_.ParticipantEntitiesInfo_"):
    """The nodes of a process."""

    gid: Gid = field(default_factory=Gid)
    node_entities_info_seq: sequence[NodeEntitiesInfo] = field(default_factory=list)

@dataclass
class TriggerRequest(IdlStruct, typename="std_srvs.srv.dds_.Trigger_Request_"):
    """Nothing."""

    structure_needs_at_least_one_member: uint8 = 0

@dataclass
class TriggerResponse(IdlStruct, typename="std_srvs.srv.dds_.Trigger_Response_"):
    """Whether it was done, and in words."""

    success: bool = False
    message: str = ""

@dataclass
class TriggerOperatingStateRequest(IdlStruct, typename="crtk_msgs.srv.dds_.TriggerOperatingState_Request_"):
    """Nothing."""

    structure_needs_at_least_one_member: uint8 = 0

@dataclass
class TriggerOperatingStateResponse(IdlStruct, typename="crtk_msgs.srv.dds_.TriggerOperatingState_Response_"):
    """The operating state."""

    operating_state: OperatingState = field(default_factory=OperatingState)

@dataclass
class QueryForwardKinematicsRequest(IdlStruct, typename="crtk_msgs.srv.dds_.QueryForwardKinematics_Request_"):
    """Joints; the pose is not used."""

    jp: sequence[float64] = field(default_factory=list)
    cp: Pose = field(default_factory=Pose)

@dataclass
class QueryForwardKinematicsResponse(IdlStruct, typename="crtk_msgs.srv.dds_.QueryForwardKinematics_Response_"):
    """The pose, if there is one, else why not."""

    cp: Pose = field(default_factory=Pose)
    result: bool = False
    message: str = ""

@dataclass
class QueryInverseKinematicsRequest(IdlStruct, typename="crtk_msgs.srv.dds_.QueryInverseKinematics_Request_"):
    """A pose, and start joints of the search."""

    cp: Pose = field(default_factory=Pose)
    jp: sequence[float64] = field(default_factory=list)

@dataclass
class QueryInverseKinematicsResponse(IdlStruct, typename="crtk_msgs.srv.dds_.QueryInverseKinematics_Response_"):
    """Joints, if there are some, else why not."""

    jp: sequence[float64] = field(default_factory=list)
    result: bool = False
    message: str = ""

@dataclass
class ConvertFloat64ArrayRequest(IdlStruct, typename="cisst_msgs.srv.dds_.ConvertFloat64Array_Request_"):
    """Numbers."""

    input: sequence[float64] = field(default_factory=list)

@dataclass
class ConvertFloat64ArrayResponse(IdlStruct, typename="cisst_msgs.srv.dds_.ConvertFloat64Array_Response_"):
    """The converted values."""

    output: sequence[float64] = field(default_factory=list)


LOG_LEVELS = {1: 20, 2: 30, 3: 40}
"""Levels of /rosout, by severity of an event."""


def time_of(ns: int) -> Time:
    """A time in ns as ROS has it."""
    return Time(*divmod(ns, 1_000_000_000))


def log_line(ns: int, name: str, severity: int, text: str, hint: str, code: str = "") -> Log:
    """A message of process `name` as a line of /rosout."""
    return Log(time_of(ns), LOG_LEVELS.get(severity, LOG_LEVELS[1]), name, f"{text}; {hint}" if hint else text, code)

"""ROS 2 messages in CDR encoding, decoded with their definitions in ROS' .msg language.

References:
    Object Management Group, "Common Object Request Broker Architecture", 3.0, section 15.3 (CDR transfer syntax);
    ROS 2 interface definition (.msg).
"""

import re
import struct
from typing import Any, NamedTuple

_PRIMITIVES = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
# Message types that drives and robots publish. Bags of ROS Iron and later hold the definitions of their own types.
_KNOWN = """
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
MSG: std_msgs/Float32
float32 data
MSG: std_msgs/Float64
float64 data
MSG: std_msgs/Int16
int16 data
MSG: std_msgs/Int32
int32 data
MSG: std_msgs/Int64
int64 data
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
MSG: std_msgs/MultiArrayLayout
MultiArrayDimension[] dim
uint32 data_offset
MSG: std_msgs/Float32MultiArray
MultiArrayLayout layout
float32[] data
MSG: std_msgs/Float64MultiArray
MultiArrayLayout layout
float64[] data
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
MSG: geometry_msgs/Twist
Vector3 linear
Vector3 angular
MSG: geometry_msgs/TwistStamped
std_msgs/Header header
Twist twist
MSG: geometry_msgs/Wrench
Vector3 force
Vector3 torque
MSG: geometry_msgs/WrenchStamped
std_msgs/Header header
Wrench wrench
MSG: sensor_msgs/JointState
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
MSG: sensor_msgs/Imu
std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
MSG: control_msgs/InterfaceValue
string[] interface_names
float64[] values
MSG: control_msgs/DynamicJointState
std_msgs/Header header
string[] joint_names
InterfaceValue[] interface_values
"""
_FIELD = re.compile(
    r"^(?P<type>[A-Za-z][\w/]*)(?P<bound><=\d+)?(?P<array>\[(?:<=)?\d*\])?\s+(?P<name>[A-Za-z]\w*)\s*(?!=)(?:\s[^=].*)?$"
)


class Field(NamedTuple):
    """Field of a message: its type, its name, its length (None: one value, 0: a sequence, else an array)."""

    kind: str
    name: str
    length: int | None


Definitions = dict[str, list[Field]]  # by "package/Type"


def parse_definitions(text: str, main: str | None = None) -> Definitions:
    """Definitions from text in ROS' .msg language, in which "MSG: package/Type" lines begin further types.

    Args:
        text: as bags hold it: comments, constants and "=====" lines are skipped.
        main: "package/Type" of the part before the first such line; None where there is no such part.
    """
    found: Definitions = {}
    current = main
    if main is not None:
        found[main] = []
    for raw in text.splitlines():
        line = raw.partition("#")[0].strip()
        if line.startswith("MSG:"):
            current = short_name(line[4:].strip())
            found[current] = []
        match = _FIELD.match(line)
        if match is None or current is None:
            continue
        array = match["array"]
        length = None if array is None else int(array[1:-1]) if array[1:-1].isdigit() else 0
        kind = match["type"]
        if kind not in _PRIMITIVES and kind not in ("string", "wstring"):
            package = current.split("/")[0]
            kind = "std_msgs/Header" if kind == "Header" else short_name(kind if "/" in kind else f"{package}/{kind}")
        found[current].append(Field(kind, match["name"], length))
    return found


def short_name(name: str) -> str:
    """The name of a type without "/msg/": "sensor_msgs/JointState" for "sensor_msgs/msg/JointState"."""
    return name.replace("/msg/", "/")


KNOWN = parse_definitions(_KNOWN)


def decode(data: bytes, kind: str, definitions: Definitions) -> dict[str, Any]:
    """A message as a dict of numbers, texts, lists and dicts.

    Args:
        data: the message, which begins with four bytes on its encoding.
        kind: "package/Type".
        definitions: definitions of this type and of the types of its fields.

    Raises:
        KeyError: for a type without a definition.
        struct.error: for data that ends too early.
    """
    return _Reader(data, definitions).message(kind)


class _Reader:
    """Reads a message from front to back.

    CDR aligns every number to a multiple of its size, counted from behind the four bytes of the encoding (OMG, CORBA
    3.0, 15.3.1).
    """

    def __init__(self, data: bytes, definitions: Definitions):
        self.data, self.definitions, self.place = data, definitions, 4
        # the lowest bit of the second byte is the byte order: 1 for little-endian
        self.order = "<" if data[1] & 1 else ">"

    def message(self, kind: str) -> dict[str, Any]:
        return {field.name: self.field(field) for field in self.definitions[kind]}

    def field(self, field: Field) -> Any:
        if field.length is None:
            return self.one(field.kind)
        length = field.length or self.number("I")
        if field.kind in _PRIMITIVES:
            code = _PRIMITIVES[field.kind]
            if length:
                self.align(struct.calcsize(code))
            found = list(struct.unpack_from(f"{self.order}{length}{code}", self.data, self.place))
            self.place += length * struct.calcsize(code)
            return found
        # a damaged length would ask for billions of elements; each takes at least one byte
        if length > len(self.data):
            raise struct.error("a sequence is longer than its message")
        return [self.one(field.kind) for _ in range(length)]

    def one(self, kind: str) -> Any:
        if kind in _PRIMITIVES:
            return self.number(_PRIMITIVES[kind])
        if kind in ("string", "wstring"):
            length = self.number("I")
            text = self.data[self.place : self.place + length]
            self.place += length
            return text.rstrip(b"\0").decode("utf-8", "replace")
        return self.message(kind)

    def number(self, code: str) -> Any:
        size = struct.calcsize(code)
        self.align(size)
        (value,) = struct.unpack_from(self.order + code, self.data, self.place)
        self.place += size
        return value

    def align(self, size: int) -> None:
        # 4 because the count begins behind the four bytes of the encoding
        self.place += (4 - self.place) % size

"""What recorders write: MCAP, ROS bags, JSON and WPILOG give the same log."""

import sqlite3
import struct

import numpy as np
import pytest
from log_files import DT, SAMPLES, assert_same

from fpjax import FpjaxWarning, InputError, read_log

pytestmark = pytest.mark.filterwarnings("ignore::fpjax.errors.FpjaxWarning")  # each test asks for its own


def test_mcap_joins_topics_on_the_torques_stamps(tmp_path, columns):
    pytest.importorskip("mcap_ros2")
    from mcap_ros2.writer import Writer

    path = tmp_path / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        command = writer.register_msgdef("std_msgs/Float64", "float64 data")
        rate = writer.register_msgdef("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z")
        for row in range(SAMPLES):
            stamp = 1_700_000_000_000_000_000 + 1_000_000 * row
            torque, velocity = columns["torque"][row], columns["velocity"][row]
            writer.write_message("/cmd", command, {"data": torque}, log_time=stamp, publish_time=stamp)
            gyro = {"x": 0.0, "y": 0.0, "z": velocity}
            writer.write_message("/gyro", rate, gyro, log_time=stamp, publish_time=stamp)
        writer.finish()
    with pytest.warns(FpjaxWarning, match="/gyro were interpolated"):
        log = read_log(path, columns="torque=/cmd.data,velocity=/gyro.z:rad/s")
    np.testing.assert_allclose(log.velocity, columns["velocity"], atol=1e-4)
    np.testing.assert_allclose(log.torque, columns["torque"], atol=1e-12)
    assert log.dt == pytest.approx(DT, rel=1e-6)


def joint_state(stamp, names, *arrays):
    """A sensor_msgs/JointState in CDR, little endian."""
    body = struct.pack("<iI", int(stamp), round((stamp % 1.0) * 1e9))

    def aligned(size, data):
        nonlocal body
        body += b"\0" * (-len(body) % size) + data

    for text in ("base\0",):
        aligned(4, struct.pack("<I", len(text)) + text.encode())
    aligned(4, struct.pack("<I", len(names)))
    for name in names:
        aligned(4, struct.pack("<I", len(name) + 1) + name.encode() + b"\0")
    for values in arrays:
        aligned(4, struct.pack("<I", len(values)))
        aligned(8, struct.pack(f"<{len(values)}d", *values))
    return b"\0\1\0\0" + body


def bag_of(path, columns, kind="sensor_msgs/msg/JointState", definition=None):
    with sqlite3.connect(path) as bag:
        bag.execute("CREATE TABLE topics (id INTEGER, name TEXT, type TEXT)")
        bag.execute("CREATE TABLE messages (id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB)")
        bag.execute("INSERT INTO topics VALUES (1, '/joint_states', ?)", (kind,))
        if definition is not None:
            bag.execute(
                "CREATE TABLE message_definitions (topic_type TEXT, encoding TEXT, encoded_message_definition TEXT)"
            )
            bag.execute("INSERT INTO message_definitions VALUES (?, 'ros2msg', ?)", (kind, definition))
        for t, u, w, q in zip(*(columns[name] for name in ("time", "torque", "velocity", "position")), strict=True):
            data = joint_state(5.0 + t, ["pan", "lift"], [q, 0.0], [w, 0.0], [u, 0.0])
            bag.execute("INSERT INTO messages VALUES (0, 1, ?, ?)", (round(1e9 * (7.0 + t)), data))


def test_a_ros_2_bag_is_read_without_ros(tmp_path, columns):
    bag_of(tmp_path / "run.db3", columns)
    with pytest.warns(FpjaxWarning, match="2 axes"):
        log = read_log(tmp_path / "run.db3")
    assert log.torque_measured
    for name in ("torque", "velocity", "position"):
        np.testing.assert_allclose(getattr(log, name), columns[name], atol=1e-12)
    assert log.dt == pytest.approx(DT)


def test_a_bag_of_unknown_messages_says_which_and_one_with_its_definitions_is_read(tmp_path, columns):
    bag_of(tmp_path / "own.db3", columns, "my_robot/msg/State")
    with pytest.raises(InputError, match="my_robot/msg/State"):
        read_log(tmp_path / "own.db3")
    definition = (
        "std_msgs/Header header  # stamp\nint8 LEFT=1\nstring[] name\nfloat64[] position\nfloat64[<=7] velocity\n"
    )
    bag_of(tmp_path / "iron.db3", columns, "my_robot/msg/State", definition + "float64[] effort\n")
    np.testing.assert_allclose(read_log(tmp_path / "iron.db3").velocity, columns["velocity"], atol=1e-12)


def test_json_in_every_shape(tmp_path, columns):
    import json

    lists = {name: values.tolist() for name, values in columns.items()}
    rows = [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
    shapes = {
        "columns.json": lists,
        "rows.json": rows,
        "entries.json": {"mass": 1.0, "motor": "mx106", "entries": rows},
        "pandas.json": {name: dict(enumerate(values)) for name, values in lists.items()},
        "run.json": {"run": lists},
    }
    for name, content in shapes.items():
        (tmp_path / name).write_text(json.dumps(content))
        mapping = {key: f"run.{key}" for key in columns} if name == "run.json" else None
        assert_same(read_log(tmp_path / name, columns=mapping), columns)
    (tmp_path / "rows.jsonl").write_text("\n".join(json.dumps(row) for row in rows))
    assert_same(read_log(tmp_path / "rows.jsonl"), columns)


def wpilog(columns, cut=0):
    """A WPILOG file as the specification has it: entries started by control records, stamps in microseconds."""

    def record(entry, stamp, payload):
        return bytes([0b1111111]) + struct.pack("<IIQ", entry, len(payload), stamp) + payload

    def text(word):
        return struct.pack("<I", len(word)) + word.encode()

    found = b"WPILOG" + struct.pack("<HI", 0x0100, 5) + b"extra"
    for number, name in enumerate(columns, start=1):
        start = b"\x00" + struct.pack("<I", number) + text(name) + text("double") + text("")
        found += record(0, 0, start)
    found += record(0, 0, b"\x00" + struct.pack("<I", 99) + text("console") + text("string") + text(""))
    for row in range(SAMPLES):
        for number, values in enumerate(columns.values(), start=1):
            found += record(number, 1000 * row, struct.pack("<d", values[row]))
        found += record(99, 1000 * row, b"hello")
    return found[: len(found) - cut]


def test_wpilog(tmp_path, columns):
    del columns["time"]
    (tmp_path / "log.wpilog").write_bytes(wpilog(columns))
    with pytest.warns(FpjaxWarning, match="interpolated onto the stamps of torque"):
        log = read_log(tmp_path / "log.wpilog")
    np.testing.assert_allclose(log.velocity, columns["velocity"], atol=1e-12)
    assert log.dt == pytest.approx(DT)
    (tmp_path / "cut.wpilog").write_bytes(wpilog(columns, cut=3))
    with pytest.warns(FpjaxWarning, match="ends within its last record"):
        read_log(tmp_path / "cut.wpilog")

"""Logs that other programs write, value by value against those programs. Each test is named after what it caught."""

import datetime
import decimal
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def convert(program, tmp_path):
    """Runs `identify convert` in the test's folder; returns the columns of its result, or stderr if it is refused."""

    def run(log, columns=None, vehicle="nursing-robot", refused=False):
        command = [program("identify"), "convert", vehicle, str(log), "--out", "out.csv"]
        if columns is not None:
            (tmp_path / "map.toml").write_text(columns)
            command += ["--columns", "map.toml"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == (2 if refused else 0), done.stderr
        if refused:
            assert done.stderr.count("\n") == 1
            return done.stderr
        with open(tmp_path / "out.csv") as file:
            names = file.readline().strip().split(",")
            values = np.array([[float(cell) for cell in line.split(",")] for line in file])
        return dict(zip(names, values.T))

    return run


def same(a, b):
    return np.array_equal(np.asarray(a, float), np.asarray(b, float), equal_nan=True)


# --- MDF4 by asammdf ----------------------------------------------------------------------------


def test_every_width_and_byte_order_of_a_measurement_file_is_read(convert, tmp_path):
    asammdf = pytest.importorskip("asammdf")
    times = np.arange(50) * 0.1
    kinds = ["u1", "i1", "<u2", ">u2", "<i2", ">i2", "<u4", ">u4", "<i4", ">i4", "<u8", ">u8", "<i8", ">i8"]
    kinds += ["<f2", "<f4", ">f4", "<f8", ">f8"]
    random = np.random.default_rng(1)
    channels = {}
    for kind in kinds:
        bits = random.integers(0, 256, (50, np.dtype(kind).itemsize), dtype="u1")
        values = bits.reshape(-1).view(kind) if np.dtype(kind).kind != "f" else random.normal(size=50).astype(kind)
        channels["c_" + kind.replace("<", "l").replace(">", "b")] = values
    file = asammdf.MDF(version="4.10")
    file.append([asammdf.Signal(values, times, name=name) for name, values in channels.items()])
    file.save(tmp_path / "log.mf4", overwrite=True)
    read = convert("log.mf4")
    for name, signal in ((name, asammdf.MDF(tmp_path / "log.mf4").get(name)) for name in channels):
        assert same(read[name], signal.samples.astype(float)), name
        assert same(read[name], channels[name].astype(float)), name


def test_conversions_of_a_measurement_file_are_applied(convert, tmp_path):
    asammdf = pytest.importorskip("asammdf")
    from asammdf.blocks.conversion_utils import from_dict

    times, raw = np.arange(60) * 0.1, np.arange(60, dtype="i2") - 20
    conversions = {
        "linear": {"a": -0.3, "b": 7.7},
        "rational": {"P1": 0.1, "P2": 3, "P3": 1, "P4": 0, "P5": 0.2, "P6": 50},
        "formula": {"formula": "X*X/7 + 2*X - sin(X)"},
        "interpolated": {f"raw_{k}": 10 * k - 25 for k in range(5)} | {f"phys_{k}": k * k for k in range(5)} | {"interpolation": True},
        "nearest": {f"raw_{k}": 10 * k - 25 for k in range(5)} | {f"phys_{k}": k * k for k in range(5)} | {"interpolation": False},
    }
    # asammdf's own reading of ranges disagrees with the standard outside of them: worked out here.
    ranges = {f"lower_{k}": 10 * k - 15 for k in range(4)} | {f"upper_{k}": 10 * k - 9 for k in range(4)}
    ranges |= {f"phys_{k}": 5.5 * k for k in range(4)} | {"default": -1}
    by_hand = [next((5.5 * k for k in range(4) if 10 * k - 15 <= x <= 10 * k - 9), -1) for x in raw]
    file = asammdf.MDF(version="4.10")
    file.append([asammdf.Signal(raw, times, name="ranges", conversion=from_dict(ranges))])
    for name, conversion in conversions.items():
        file.append([asammdf.Signal(raw, times, name=name, conversion=from_dict(conversion))])
    file.save(tmp_path / "log.mf4", overwrite=True)
    read, oracle = convert("log.mf4"), asammdf.MDF(tmp_path / "log.mf4")
    assert same(read["ranges"], by_hand)
    for name in conversions:
        # Another library's sine and order of sums may differ in the last digits.
        near = {"rtol": 1e-12, "atol": 1e-12} if name == "formula" else {"rtol": 1e-15, "atol": 1e-15}
        assert np.allclose(read[name], oracle.get(name).samples.astype(float), **near), name


@pytest.mark.parametrize("compression", [0, 1, 2])
def test_columns_and_rows_of_newer_measurement_files_are_read(convert, tmp_path, compression):
    asammdf = pytest.importorskip("asammdf")
    # More than is read at once.
    counts = np.arange(40_000)
    times = counts * 0.01
    invalid = counts % 3 == 1
    for version in ["4.00", "4.11", "4.20"]:
        file = asammdf.MDF(version=version)
        bits = {} if version == "4.00" else {"invalidation_bits": invalid}
        file.append([
            asammdf.Signal(np.sin(times), times, name="speed", unit="m/s", **bits),
            asammdf.Signal(counts, times, name="torque_left", unit="Nm"),
        ])
        file.configure(write_fragment_size=4 << 20)
        file.save(tmp_path / "log.mf4", overwrite=True, compression=compression)
        read = convert("log.mf4")
        assert same(read["time"], times) and same(read["torque_left"], counts)
        assert same(read["speed"], np.where(invalid & (version != "4.00"), np.nan, np.sin(times)))


def test_a_speed_at_another_rate_leaves_the_slip_stiffness_right(program, tmp_path):
    """Held between its samples, a speed at 20 Hz made a loader's tyres look 40 % too soft."""
    asammdf = pytest.importorskip("asammdf")
    identify = lambda *arguments: subprocess.run([program("identify"), *arguments], cwd=tmp_path, capture_output=True, text=True)
    fitted = {}
    for seed in ["1", "2", "3"]:
        assert identify("simulate", "wheel-loader", "--scenario", "bumpy-c", "--seed", seed, "--out", "fast.csv").returncode == 0
        with open(tmp_path / "fast.csv") as file:
            names = file.readline().strip().split(",")
            columns = dict(zip(names, np.array([[float(cell) for cell in line.split(",")] for line in file]).T))
        log = asammdf.MDF(version="4.10")
        inputs = [name for name in names if name not in ("time", "speed") and not name.startswith("true_")]
        log.append([asammdf.Signal(columns[name], columns["time"], name=name) for name in inputs])
        log.append([asammdf.Signal(columns["speed"][::5], columns["time"][::5], name="speed", unit="m/s")])
        log.save(tmp_path / "slow.mf4", overwrite=True)
        done = identify("fit", "wheel-loader", "slow.mf4", "--out", "fit.json")
        assert done.returncode in (0, 1) and "missing between" in done.stderr
        found = json.loads((tmp_path / "fit.json").read_text())["parameters"]["initial.slip_stiffness"]
        fitted[seed] = (found["value"] - columns["true_slip_stiffness"][0]) / found["std_error"]
    assert max(map(abs, fitted.values())) < 2.5, fitted


# --- Parquet by pyarrow -------------------------------------------------------------------------


def test_types_that_say_more_than_their_physical_integer_are_obeyed(convert, tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    count = 200
    stamps = 1_700_000_000_123_456_789 + np.arange(count) * 10_000_019
    cents = [decimal.Decimal(k) / 100 - 1 for k in range(count)]
    long = [decimal.Decimal(10**30 + k).scaleb(-12) for k in range(count)]
    table = pyarrow.table({
        "time": np.arange(count) * 0.01,
        "u8": pyarrow.array(np.arange(count) % 256, pyarrow.uint8()),
        "u32": pyarrow.array(4_294_960_000 + np.arange(count), pyarrow.uint32()),
        "u64": pyarrow.array([2**64 - 1 - k for k in range(count)], pyarrow.uint64()),
        "half": pyarrow.array(np.linspace(-3, 3, count).astype("f2")),
        "cents": pyarrow.array(cents, pyarrow.decimal128(9, 2)),
        "more_cents": pyarrow.array(cents, pyarrow.decimal128(18, 2)),
        "long": pyarrow.array(long, pyarrow.decimal128(38, 12)),
        "days": pyarrow.array(np.arange(count, dtype="i4"), pyarrow.date32()),
        "stamp_ns": pyarrow.array(stamps, pyarrow.timestamp("ns")),
        "stamp_us": pyarrow.array(stamps // 1000, pyarrow.timestamp("us", "UTC")),
        "stamp_s": pyarrow.array(stamps // 10**9, pyarrow.timestamp("s")),
        "of_day": pyarrow.array(np.arange(count) * 1000, pyarrow.time64("us")),
        "took_ns": pyarrow.array(np.arange(count) * 10_000_000, pyarrow.duration("ns")),
        "took_ms": pyarrow.array(np.arange(count) * 10, pyarrow.duration("ms")),
        "took_s": pyarrow.array(np.arange(count), pyarrow.duration("s")),
        "note": ["a"] * count,
        "list": [[1.0]] * count,
    })
    for form in [{}, {"version": "1.0", "coerce_timestamps": "us", "allow_truncated_timestamps": True}, {"use_dictionary": False, "data_page_version": "2.0"}, {"store_decimal_as_integer": True}]:
        parquet.write_table(table, tmp_path / "log.parquet", **form)
        read = convert("log.parquet")
        nearest = lambda values: np.array([float(value) for value in values])
        assert same(read["u8"], np.arange(count)) and same(read["u32"], 4_294_960_000 + np.arange(count))
        assert same(read["u64"], nearest(2**64 - 1 - k for k in range(count)))
        assert same(read["half"], np.linspace(-3, 3, count).astype("f2"))
        assert same(read["cents"], nearest(cents)) and same(read["more_cents"], nearest(cents))
        assert same(read["long"], nearest(long))
        assert same(read["days"], np.arange(count) * 86400.0)
        if "version" not in form:
            # Version 1.0 of the format knows no nanoseconds: pyarrow rounds them off.
            exact = nearest(decimal.Decimal(int(k)).scaleb(-9) for k in stamps)
            assert np.max(np.abs(read["stamp_ns"] - exact)) <= np.spacing(exact[0])
        assert same(read["stamp_s"], stamps // 10**9)
        assert np.allclose(read["stamp_us"], (stamps // 1000) / 1e6, rtol=0, atol=2.5e-7)
        assert same(read["of_day"], np.arange(count) / 1000)
        assert same(read["took_ns"], np.arange(count) / 100) and same(read["took_ms"], np.arange(count) / 100)
        assert same(read["took_s"], np.arange(count))
        assert "note" not in read and "list" not in read


def test_times_of_spark_are_read_and_a_unit_that_does_not_apply_is_refused(convert, tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    stamps = pyarrow.array([1_700_000_000_000_000_000 + k * 10**7 for k in range(9)], pyarrow.timestamp("ns"))
    table = pyarrow.table({"time": stamps, "speed": np.arange(9.0)})
    parquet.write_table(table, tmp_path / "log.parquet", use_deprecated_int96_timestamps=True)
    assert np.allclose(convert("log.parquet")["time"], 1.7e9 + np.arange(9) * 0.01, rtol=0, atol=2.5e-7)
    error = convert("log.parquet", 'time = { column = "time", unit = "us" }\n', refused=True)
    assert "'time' holds times by its type" in error
    error = convert("log.parquet", 'speed = "time"\n', refused=True)
    assert "recorded in s" in error


def test_an_index_that_pandas_only_counts_is_a_column(convert, tmp_path):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"speed": np.arange(5.0)}, index=pandas.RangeIndex(10, 60, 10, name="time"))
    frame.to_parquet(tmp_path / "log.parquet")
    assert same(convert("log.parquet")["time"], [10, 20, 30, 40, 50])
    frame.index = pandas.to_timedelta(np.arange(5) * 0.01, unit="s").rename("time")
    frame.to_parquet(tmp_path / "log.parquet")
    assert same(convert("log.parquet")["time"], np.arange(5) / 100)


# --- CSV by pandas ------------------------------------------------------------------------------


@pytest.mark.parametrize("separator,decimal", [(",", "."), (";", "."), (";", ","), ("\t", ","), ("|", ".")])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
@pytest.mark.parametrize("ending", ["csv", "csv.gz"])
def test_dialects_that_pandas_writes_are_read(convert, tmp_path, separator, decimal, encoding, ending):
    pandas = pytest.importorskip("pandas")
    random = np.random.default_rng(2)
    speed = np.where(np.arange(500) % 7 == 3, np.nan, random.normal(size=500))
    stamps = pandas.date_range("2024-05-06T12:00:00", periods=500, freq="10ms", tz="UTC")
    frame = pandas.DataFrame({"time": stamps, "speed": speed, "Öl [°C]": random.normal(size=500), "note": "ok, fine"})
    frame.to_csv(tmp_path / f"log.{ending}", index=False, sep=separator, decimal=decimal, encoding=encoding, na_rep="NA")
    read = convert(f"log.{ending}")
    assert same(read["speed"], speed)
    assert np.allclose(read["time"] - read["time"][0], np.arange(500) / 100, rtol=0, atol=2.5e-7)
    assert read["time"][0] == datetime.datetime(2024, 5, 6, 12, tzinfo=datetime.timezone.utc).timestamp()
    # Columns that nobody needs come in SI as well.
    assert np.allclose(read["Öl"], frame["Öl [°C]"] + 273.15, rtol=1e-15)


# --- MCAP by rosbags ----------------------------------------------------------------------------

MAP = """
speed = "/odom.twist.twist.linear.x"
yaw_rate = { column = "twist.twist.angular.z", group = "/odom" }
covariance = "/odom.pose.covariance[35]"
position = { column = "/joint_states.position[2]", between = "linear" }
velocity = "/joint_states.velocity[0]"
"""
START = 1_700_000_000_000_000_000


def record(folder, stamped=True, compress=None, version=9):
    """A recording of odometry at 100 Hz and of joints at 20 Hz, each message 3 ms late."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = {name.rsplit("/", 1)[1]: store.types[name] for name in store.types}

    def header(k):
        stamp = START + k * 10_000_000 if stamped else 0
        time = types["Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return store.types["std_msgs/msg/Header"](stamp=time, frame_id="base" * (k % 4))

    def odometry(k):
        vector, point = types["Vector3"], types["Point"]
        pose = types["Pose"](position=point(x=1.0 * k, y=2.0, z=3.0), orientation=types["Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0))
        twist = types["Twist"](linear=vector(x=np.sin(k), y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=np.cos(k)))
        return types["Odometry"](
            header=header(k), child_frame_id="odom" + "x" * (k % 5),
            pose=types["PoseWithCovariance"](pose=pose, covariance=np.arange(36.0) + k),
            twist=types["TwistWithCovariance"](twist=twist, covariance=np.zeros(36)),
        )

    def joints(k):
        return types["JointState"](header=header(k), name=["left", "right_", "x"], position=np.array([0.1, 0.2, 0.3]) * k,
                                   velocity=np.array([float(k)]), effort=np.array([]))

    writer = rosbag2.Writer(folder, version=version, storage_plugin=rosbag2.StoragePlugin.MCAP)
    if compress:
        writer.set_compression(rosbag2.CompressionMode.STORAGE, compress)
    with writer:
        odom = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
        state = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for k in range(100):
            late = START + k * 10_000_000 + 3_000_000
            writer.write(odom, late, store.serialize_cdr(odometry(k), "nav_msgs/msg/Odometry"))
            if k % 5 == 0:
                writer.write(state, late, store.serialize_cdr(joints(k), "sensor_msgs/msg/JointState"))
    return next(Path(folder).glob("*.mcap"))


def assert_drive(read, late=0.0):
    k = np.arange(100)
    assert np.allclose(read["time"], START / 1e9 + k / 100 + late, rtol=0, atol=5e-7)
    assert same(read["speed"], np.sin(k)) and same(read["yaw_rate"], np.cos(k)) and same(read["covariance"], 35.0 + k)
    assert same(read["velocity"], np.where(k % 5 == 0, k, np.nan))
    inside = k <= 95
    assert np.allclose(read["position"][inside], 0.3 * k[inside], rtol=1e-5) and np.isnan(read["position"][~inside]).all()


def test_topics_and_fields_of_a_recording_are_channels(convert, tmp_path):
    path = record(tmp_path / "bag")
    assert_drive(convert(path, MAP))
    assert_drive(convert(path, MAP + '[mcap]\ntime = "log"\n'), late=0.003)
    error = convert(path, refused=True)
    assert "/odom" in error and "/joint_states" in error and "column map" in error
    error = convert(path, 'speed = "/odom.twist.twist.linear.w"\n', refused=True)
    assert "no column '/odom.twist.twist.linear.w'" in error


def test_messages_without_stamps_have_the_time_of_their_recording(convert, tmp_path):
    path = record(tmp_path / "bag", stamped=False)
    assert_drive(convert(path, MAP), late=0.003)
    error = convert(path, MAP + '[mcap]\ntime = "header"\n', refused=True)
    assert "headers without a stamp" in error


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_packed_chunks_standard_messages_and_files_cut_short_are_read(convert, tmp_path, compression):
    """The same messages in chunks, by the container's own writer, with and without their definitions."""
    writers = pytest.importorskip("mcap.writer")
    readers = pytest.importorskip("mcap.reader")
    source = record(tmp_path / "bag")
    for defined in [True, False]:
        with open(source, "rb") as old, open(tmp_path / "log.mcap", "wb") as new:
            writer = writers.Writer(new, compression=getattr(writers.CompressionType, compression), chunk_size=4096)
            writer.start()
            channels = {}
            for schema, channel, message in readers.make_reader(old).iter_messages(log_time_order=False):
                if channel.id not in channels:
                    text = schema.data if defined else b""
                    number = writer.register_schema(schema.name, schema.encoding if defined else "", text)
                    channels[channel.id] = writer.register_channel(channel.topic, "cdr", number)
                writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
            writer.finish()
        assert_drive(convert("log.mcap", MAP))
    # What a recorder that lost power leaves is read up to there.
    whole = (tmp_path / "log.mcap").read_bytes()
    (tmp_path / "log.mcap").write_bytes(whole[: len(whole) // 2])
    read = convert("log.mcap", 'speed = "/odom.twist.twist.linear.x"\n')
    count = len(read["speed"])
    assert 10 < count < 100 and same(read["speed"], np.sin(np.arange(count)))


# --- CAN by python-can and cantools -------------------------------------------------------------

DBC = """VERSION ""
NS_ :
BS_:
BU_: ECU
BO_ 256 Motion: 8 ECU
 SG_ Speed : 7|16@0+ (0.01,0) [0|300] "km/h" ECU
 SG_ YawRate : 16|12@1- (0.1,-5) [-200|200] "deg/s" ECU
 SG_ Mode : 28|4@1+ (1,0) [0|15] "" ECU
 SG_ Float : 32|32@1- (1,0) [0|0] "N.m" ECU
BO_ 2566844672 Multiplexed: 8 ECU
 SG_ Which M : 0|8@1+ (1,0) [0|3] "" ECU
 SG_ Left m0 : 8|16@1- (0.5,0) [0|0] "N.m" ECU
 SG_ Right m1 : 8|16@1- (0.5,0) [0|0] "N.m" ECU
SIG_VALTYPE_ 256 Float : 1;
"""


@pytest.mark.parametrize("ending", ["blf", "asc", "log"])
def test_signals_of_a_bus_are_decoded(convert, tmp_path, ending):
    can, cantools = pytest.importorskip("can"), pytest.importorskip("cantools")
    (tmp_path / "car.dbc").write_text(DBC)
    database = cantools.database.load_string(DBC)
    motion, multiplexed = database.get_message_by_name("Motion"), database.get_message_by_name("Multiplexed")
    expected, frames = [], []
    random = np.random.default_rng(3)
    for k in range(200):
        values = {"Speed": round(random.uniform(0, 300), 2), "YawRate": round(random.uniform(-150, 150), 1), "Mode": k % 16,
                  "Float": float(np.float32(random.normal()))}
        data = motion.encode(values)
        expected.append(motion.decode(data))
        time = 100 + 0.01 * k
        frames.append(can.Message(timestamp=time, arbitration_id=256, is_extended_id=False, data=data, channel=1, is_rx=True))
        data = multiplexed.encode({"Which": k % 2, "Left" if k % 2 == 0 else "Right": k / 2})
        frames.append(can.Message(timestamp=time, arbitration_id=multiplexed.frame_id, is_extended_id=True, data=data, channel=1))
        frames.append(can.Message(timestamp=time, arbitration_id=0x7FF, is_extended_id=False, is_remote_frame=True, channel=1))
    with can.Logger(str(tmp_path / f"log.{ending}")) as logger:
        for frame in frames:
            logger(frame)
    columns = '[can]\ndbc = "car.dbc"\n'
    columns = (
        'speed = "Motion.Speed"\nyaw_rate = "Motion/YawRate"\nmode = "Mode"\ntorque_left = "Motion.Float"\n'
        'left = "Multiplexed.Left"\n' + columns
    )
    read = convert(f"log.{ending}", columns)
    signal = lambda name: np.array([float(values[name]) for values in expected])
    assert np.allclose(read["speed"], signal("Speed") / 3.6, rtol=1e-14)
    assert np.allclose(read["yaw_rate"], np.radians(signal("YawRate")), rtol=1e-14, atol=1e-16)
    assert same(read["mode"], signal("Mode")) and same(read["torque_left"], signal("Float"))
    assert same(read["left"], np.where(np.arange(200) % 2 == 0, np.arange(200) / 2, np.nan))
    assert np.allclose(np.diff(read["time"]), 0.01, rtol=0, atol=2e-6)
    assert "database" in convert(f"log.{ending}", refused=True)

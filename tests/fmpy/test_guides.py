"""The code of the guides, as it stands there, as a new user runs it in an empty folder; tests/python has the README's."""

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile

import fmpy
import numpy as np
import pytest

import test_logs
from conftest import BIN, FMUS, ROOT

GUIDES = ["README.md", "fmu/README.md", "identify/README.md", "CONTRIBUTING.md"]


def blocks(guide):
    """Language and text of every code block; one in a list item is indented."""
    text = (ROOT / guide).read_text()
    found = re.findall(r"^( *)```(\w*)\n(.*?)^ *```$", text, re.S | re.M)
    return [(language, re.sub(f"^{indent}", "", code, flags=re.M)) for indent, language, code in found]


def toml(guide, word):
    """The column map of a guide in which a word stands."""
    (found,) = [code for language, code in blocks(guide) if language == "toml" and word in code]
    return found


def test_every_block_says_what_it_is():
    for guide in GUIDES:
        for language, code in blocks(guide):
            assert language in ("sh", "python", "toml", "text"), (guide, code)


def run(language, code, folder):
    """Runs a block; `identify fit` may say that some parameters stay at their defaults."""
    environment = {**os.environ, "PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}"}
    steps = [[sys.executable, "-c", code]] if language == "python" else [["bash", "-c", line] for line in code.splitlines()]
    for step in steps:
        done = subprocess.run(step, cwd=folder, env=environment, capture_output=True, text=True)
        allowed = (0, 1) if step[-1].startswith("identify fit") else (0,)
        assert done.returncode in allowed, f"{step[-1]}\n{done.stdout}{done.stderr}"
    return done.stdout


def test_the_fmu_guides_commands_pack_and_verify(program, tmp_path):
    with zipfile.ZipFile(FMUS / "Wheelchair.fmu") as archive:
        (tmp_path / "mine.ssv").write_bytes(archive.read("resources/Wheelchair.ssv"))
    simulate = "identify simulate wheelchair --scenario identification --seed 2 --out log.csv"
    run("sh", f"{simulate}\nidentify fit wheelchair log.csv --out fit.json", tmp_path)
    ran = [run(language, code, tmp_path) for language, code in blocks("fmu/README.md") if language in ("sh", "python")]
    assert len(ran) == 2 and ran[0].count("verified") == 5


def test_the_identify_guides_commands_give_estimates_a_report_and_smoothed_estimates(program, tmp_path):
    for language, code in blocks("identify/README.md"):
        if language == "sh":
            run(language, code, tmp_path)
    estimates, smoothed = fmpy.read_csv(tmp_path / "estimates.csv"), fmpy.read_csv(tmp_path / "smoothed.csv")
    assert estimates["load_mass"][-1] > 0 and "innovation_speed_std" in estimates.dtype.names
    truth = fmpy.read_csv(tmp_path / "ride.csv")["true_body_pitch"]
    error = lambda values: np.sqrt(np.mean((values - truth) ** 2))
    assert error(smoothed["body_pitch_smoothed"]) < 0.8 * error(smoothed["body_pitch"])
    page = (tmp_path / "run.html").read_text()
    assert page.count("<svg") > 10 and "http" not in page.replace("http://www.w3.org/", "")


def test_the_maps_of_the_identify_guide_read_what_they_describe(program, tmp_path):
    columns = ["time_s", "v_kmh", "motor_torque_Nm", "v right", "v left", "delta", "n_left", "imu/ax"]
    rows = [[0.01 * k, 9.0 if k < 3 else 18.0, 10.0, 1.1, 0.55, 0.02, 60.0, 0.5] for k in range(200)]
    lines = [",".join(columns)] + [",".join(map(str, row)) for row in rows]
    (tmp_path / "trip.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "trip_gps.csv").write_text("t,latitude\n" + "".join(f"{0.1 * k},{k}\n" for k in range(30)))
    (tmp_path / "map.toml").write_text(toml("identify/README.md", "v_kmh"))
    run("sh", "identify convert nursing-robot trip.csv --columns map.toml --out out.csv", tmp_path)
    read = fmpy.read_csv(tmp_path / "out.csv")
    assert np.allclose(read["speed"][3:], 5.0) and np.allclose(read["yaw_rate"], 1.0) and np.allclose(read["steering_angle"], 0.02)
    assert np.isnan(read["torque_left"][:3]).all() and np.allclose(read["torque_left"][3:], 46.392)
    assert np.allclose(np.diff(read["encoder_left"]), 0.02 * np.pi) and np.allclose(read["accel_x"], 0.5)
    assert "lat" in " ".join(read.dtype.names)


def test_the_map_for_recordings_of_robots_takes_the_recordings_times(program, tmp_path):
    log = test_logs.record(tmp_path / "bag")
    (tmp_path / "map.toml").write_text(toml("identify/README.md", "[mcap]"))
    run("sh", f"identify convert nursing-robot {log} --columns map.toml --out out.csv", tmp_path)
    read = fmpy.read_csv(tmp_path / "out.csv")
    assert np.allclose(read["speed"], np.sin(np.arange(100)))
    assert abs(read["time"][0] % 0.01 - 0.003) < 1e-6


def test_the_map_for_a_bus_decodes_its_signal(program, tmp_path):
    can, cantools = pytest.importorskip("can"), pytest.importorskip("cantools")
    (tmp_path / "car.dbc").write_text(test_logs.DBC)
    motion = cantools.database.load_string(test_logs.DBC).get_message_by_name("Motion")
    with can.Logger(str(tmp_path / "log.asc")) as logger:
        for k in range(50):
            data = motion.encode({"Speed": 36.0, "YawRate": 0.0, "Mode": 0, "Float": 0.0})
            message = can.Message(timestamp=100 + 0.01 * k, arbitration_id=256, is_extended_id=False, data=data, channel=1, is_rx=True)
            logger(message)
    (tmp_path / "map.toml").write_text(toml("identify/README.md", "[can]"))
    run("sh", "identify convert nursing-robot log.asc --columns map.toml --out out.csv", tmp_path)
    assert np.allclose(fmpy.read_csv(tmp_path / "out.csv")["speed"], 10.0)


def test_commands_that_build_name_what_there_is():
    """They take minutes; here only their packages, programs, tests, benchmarks and files are looked up."""
    cargo = [shutil.which("cargo"), "metadata", "--format-version", "1", "--no-deps", "--manifest-path", str(ROOT / "Cargo.toml")]
    packages = {p["name"]: p for p in json.loads(subprocess.run(cargo, capture_output=True, check=True).stdout)["packages"]}
    looked_at = 0
    for guide in GUIDES:
        for line in "\n".join(code for language, code in blocks(guide) if language == "text").splitlines():
            words = line.split("#")[0].split()
            options = dict(zip(words, words[1:]))
            for name in [after for before, after in zip(words, words[1:]) if before == "-p"]:
                assert name in packages, line
                looked_at += 1
            for kind in ("test", "bench", "bin"):
                if f"--{kind}" in options:
                    targets = {target["name"] for target in packages[options["-p"]]["targets"] if kind in target["kind"]}
                    assert options[f"--{kind}"] in targets, line
            if words and re.fullmatch(r"(\./)?[\w/]+\.sh", words[0]):
                assert (ROOT / words[0]).is_file(), line
                looked_at += 1
    assert looked_at >= 8

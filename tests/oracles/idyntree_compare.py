"""Compares `identify estimate` and `identify bench` with iDynTree's BerdySparseMAPSolver.

Same URDF, same sensors, same variances, one run on one machine:
  1. estimates of joint torques agree (means; iDynTree gives no variances),
  2. median time of a step: ours without and with all variances against iDynTree's mean only,
     measured by turns so that a loaded machine slows both.

Usage: python idyntree_compare.py --identify target/release/identify [--steps 400] [--tolerance 1e-8]
Needs: pip install idyntree numpy. Models: tests/vectors/human_dynamics/model_*.urdf.gz.
"""

import argparse
import csv
import gzip
import json
import pathlib
import subprocess
import sys
import tempfile
import time

import idyntree.swig as idyn
import numpy as np

VECTORS = pathlib.Path(__file__).resolve().parents[1] / "vectors" / "human_dynamics"
MODELS = [("human48", "LeftFoot"), ("seated12", "Pelvis"), ("chain3", "base")]
GRAVITY = [1.5631752280112634, 1.508699500271739, -9.566420909849816]
VARIANCE = {"joint_acceleration": 0.004, "net_ext_wrench": 1e-4, "accelerometer": 0.0011, "model": 1e-4, "prior": 1e4}


class Anchor:
    """iDynTree's estimator of one model: all joint accelerations, all external wrenches, some IMUs."""

    def __init__(self, urdf, base, imu_links):
        loader = idyn.ModelLoader()
        assert loader.loadModelFromFile(str(urdf)), urdf
        self.model = loader.model().copy()
        self.base = base
        for link in imu_links:
            sensor = idyn.AccelerometerSensor()
            sensor.setName(f"imu_{link}")
            sensor.setParentLink(link)
            sensor.setParentLinkIndex(self.model.getLinkIndex(link))
            sensor.setLinkSensorTransform(idyn.Transform(idyn.Rotation.RPY(0.2, -0.1, 0.3), idyn.Position(0.03, 0.02, -0.05)))
            self.model.sensors().addSensor(sensor)
        options = idyn.BerdyOptions()
        options.berdyVariant = idyn.ORIGINAL_BERDY_FIXED_BASE
        options.baseLink = base
        options.includeAllJointAccelerationsAsSensors = True
        options.includeAllJointTorquesAsSensors = False
        options.includeAllNetExternalWrenchesAsDynamicVariables = True
        options.includeAllNetExternalWrenchesAsSensors = True
        options.includeFixedBaseExternalWrench = False
        self.helper = idyn.BerdyHelper()
        assert self.helper.init(self.model, options)
        self.n_d = self.helper.getNrOfDynamicVariables()
        self.n_eq = self.helper.getNrOfDynamicEquations()
        self.n_y = self.helper.getNrOfSensorsMeasurements()
        self.sensors = [(s.type, s.id, s.range.offset, s.range.size) for s in self.helper.getSensorsOrdering()]
        self.solver = idyn.BerdySparseMAPSolver(self.helper)
        assert self.solver.initialize()
        # initialize() resets the covariances, so they are set after it
        self.solver.setDynamicsConstraintsPriorCovariance(diagonal(np.full(self.n_eq, VARIANCE["model"])))
        self.solver.setDynamicsRegularizationPriorCovariance(diagonal(np.full(self.n_d, VARIANCE["prior"])))
        self.solver.setDynamicsRegularizationPriorExpectedValue(vector(np.zeros(self.n_d)))
        self.solver.setMeasurementsPriorCovariance(diagonal(self.variances()))
        self.base_frame = self.model.getFrameIndex(base)
        self.joints = [self.model.getJointName(j) for j in range(self.model.getNrOfJoints()) if self.model.getJoint(j).getNrOfDOFs() == 1]
        self.gravity = idyn.Vector3.FromPython(GRAVITY)

    def variances(self):
        out = np.zeros(self.n_y)
        kinds = {
            idyn.DOF_ACCELERATION_SENSOR: "joint_acceleration",
            idyn.NET_EXT_WRENCH_SENSOR: "net_ext_wrench",
            idyn.ACCELEROMETER_SENSOR: "accelerometer",
        }
        for kind, _, offset, size in self.sensors:
            out[offset : offset + size] = VARIANCE[kinds[kind]]
        return out

    def names(self):
        """Column names of the samples, in iDynTree's order."""
        out = [None] * self.n_y
        for kind, name, offset, size in self.sensors:
            for k in range(size):
                if kind == idyn.DOF_ACCELERATION_SENSOR:
                    out[offset + k] = f"qdd_{name}"
                elif kind == idyn.NET_EXT_WRENCH_SENSOR:
                    out[offset + k] = f"fx_{name}_{k}"
                else:
                    out[offset + k] = f"{name}_{k}"
        return out

    def arrays(self, q, qd):
        positions, velocities = idyn.JointPosDoubleArray(self.model), idyn.JointDOFsDoubleArray(self.model)
        for k in range(len(q)):
            positions.setVal(k, float(q[k]))
            velocities.setVal(k, float(qd[k]))
        return positions, velocities

    def step(self, arrays, y):
        """The solver's whole step: new posture and samples, then the estimate."""
        self.solver.updateEstimateInformationFixedBase(arrays[0], arrays[1], self.base_frame, self.gravity, y)
        assert self.solver.doEstimate()

    def torques(self):
        # the torque variables themselves: iDynTree's own extraction projects the joint wrenches,
        # which differ from them by the ratio of the model's variance to the prior's
        estimate = self.solver.getLastEstimate()
        offsets = [self.helper.getRangeDOFVariable(idyn.DOF_TORQUE, k).offset for k in range(len(self.joints))]
        return np.array([estimate.getVal(k) for k in offsets])


def vector(values):
    out = idyn.VectorDynSize(len(values))
    for k, value in enumerate(values):
        out.setVal(k, float(value))
    return out


def diagonal(values):
    matrix = idyn.SparseMatrixColMajor()
    matrix.resize(len(values), len(values))
    for k, value in enumerate(values):
        matrix.setValue(k, k, float(value))
    return matrix


def sensors_toml(anchor, links, imu_links):
    lines = [
        f'base = "{anchor.base}"',
        'variant = "fixed"',
        f"gravity = {GRAVITY}",
        "[variance]",
        *(f"{kind} = {VARIANCE['model']}" for kind in ("acceleration", "net_wrench", "wrench_balance", "torque")),
        f"prior = {VARIANCE['prior']}",
    ]

    def sensor(kind, target, columns, extra=()):
        lines.extend(["[[sensor]]", f'type = "{kind}"', target, f"variance = {VARIANCE[kind]}", *extra])
        lines.append("columns = [" + ", ".join(f'"{c}"' for c in columns) + "]")

    for joint in anchor.joints:
        sensor("joint_acceleration", f'joint = "{joint}"', [f"qdd_{joint}"])
    for link in links:
        if link != anchor.base:
            sensor("net_ext_wrench", f'link = "{link}"', [f"fx_{link}_{k}" for k in range(6)])
    for link in imu_links:
        pose = ["xyz = [0.03, 0.02, -0.05]", "rpy = [0.2, -0.1, 0.3]"]
        sensor("accelerometer", f'link = "{link}"', [f"imu_{link}_{k}" for k in range(3)], pose)
    return "\n".join(lines) + "\n"


def compare(name, base, args, folder):
    urdf = folder / f"{name}.urdf"
    urdf.write_bytes(gzip.decompress((VECTORS / f"model_{name}.urdf.gz").read_bytes()))
    text = urdf.read_text()
    links = [part.split('"')[1] for part in text.split("<link name=")[1:]]
    massive = [l for l in links if "_f" not in l and l != base]
    anchor = Anchor(urdf, base, massive)
    toml = folder / f"{name}.toml"
    toml.write_text(sensors_toml(anchor, links, massive))

    random = np.random.default_rng(1)
    n, rows = len(anchor.joints), 25
    q, qd = random.uniform(-0.5, 0.5, (rows, n)), random.normal(0, 1, (rows, n))
    y = random.normal(0, 1, (rows, anchor.n_y)) * np.sqrt(anchor.variances())
    log = folder / f"{name}.csv"
    with log.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["time", *(f"q_{j}" for j in anchor.joints), *(f"qd_{j}" for j in anchor.joints), *anchor.names()])
        for k in range(rows):
            out.writerow([repr(float(v)) for v in (0.01 * k, *q[k], *qd[k], *y[k])])
    result = folder / f"{name}_result.csv"
    command = [args.identify, "estimate", "human-dynamics", log, "--model", urdf, "--sensors", toml, "--out", result]
    subprocess.run([str(c) for c in command], check=True, stdout=subprocess.DEVNULL)
    with result.open() as file:
        ours = list(csv.DictReader(file))

    worst, largest = 0.0, 0.0
    for k in range(rows):
        arrays = anchor.arrays(q[k], qd[k])
        anchor.step(arrays, vector(y[k]))
        theirs = anchor.torques()
        mine = np.array([float(ours[k][f"tau_{j}"]) for j in anchor.joints])
        worst = max(worst, np.abs(mine - theirs).max())
        largest = max(largest, np.abs(theirs).max())

    # by turns: some steps of the anchor, one bench of ours, and again
    times, mean_only, with_variances = [], [], []
    prepared = [(anchor.arrays(q[k], qd[k]), vector(y[k])) for k in range(rows)]
    for _ in range(3):
        for k in range(args.steps // 3):
            arrays, samples = prepared[k % rows]
            start = time.thread_time()
            anchor.step(arrays, samples)
            times.append(time.thread_time() - start)
        command = [args.identify, "bench", "human-dynamics", "--model", urdf, "--sensors", toml, "--steps", args.steps]
        line = json.loads(subprocess.run([str(c) for c in command], check=True, capture_output=True).stdout)
        mean_only.append(line["mean_only_us"])
        with_variances.append(line["with_variances_us"])
    theirs = 1e6 * float(np.median(times))
    mean, full = min(mean_only), min(with_variances)
    print(
        f"{name}: {anchor.n_d} variables, {anchor.n_y} measurements | torques agree to {worst:.1e} (largest {largest:.0f} N.m) | "
        f"iDynTree mean only {theirs:.0f} us; ours mean only {mean:.0f} us ({mean / theirs:.3f}), "
        f"with all variances {full:.0f} us ({full / theirs:.3f})"
    )
    return worst <= args.tolerance


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--identify", default="target/release/identify")
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--tolerance", type=float, default=1e-8)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        good = [compare(name, base, args, pathlib.Path(folder)) for name, base in MODELS]
    sys.exit(0 if all(good) else 1)


if __name__ == "__main__":
    main()

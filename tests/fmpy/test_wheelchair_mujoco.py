"""The wheelchair's estimator on chairs of MuJoCo, whose wheels slip, lift and bounce over a ramp's edges.

The worst of four chairs (sprung casters, little friction, unknown rolling resistance) and four seeds each.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import FMUS
from support import Slave

sys.path.append(str(Path(__file__).parents[1] / "oracles"))
from wheelchair_mujoco import CASES, VARIANTS, errors, estimate, measured, simulate

BASIC, BIAS = 1, 2
CHAIRS = ["plain", "sprung", "slippery", "resisted"]
# slope (rad), speed (m/s) and heading (rad), each root mean square and largest: the default kind, biased sensors
BOUNDS = {
    "climb": ((0.005, 0.028), (0.013, 0.10), (0.0013, 0.005)),
    "oblique": ((0.017, 0.058), (0.019, 0.13), (0.021, 0.042)),
    "moment": ((0.010, 0.042), (0.024, 0.20), (0.030, 0.065)),
    "across": ((0.020, 0.050), (0.025, 0.18), (0.0013, 0.005)),
}
# the same of six states, calibrated sensors and the plain chair: what the reference prototype reached
CALIBRATED = {
    "climb": ((0.0042, 0.0174), (0.0092, 0.091), (0.0013, 0.005)),
    "oblique": ((0.0069, 0.038), (0.0110, 0.091), (0.021, 0.030)),
    "moment": ((0.0045, 0.0174), (0.0092, 0.091), (0.003, 0.030)),
}


@pytest.fixture(scope="module")
def plants():
    return {(case, name): simulate(CASES[case], VARIANTS[name]) for case in BOUNDS for name in CHAIRS}


@pytest.fixture(scope="module")
def run(plants, extracted):
    def runs(case, name, kind, biased):
        _, inputs, truth = plants[case, name]
        for seed in range(4):
            with Slave(extracted(FMUS / "Wheelchair.fmu")) as slave:
                log = measured(inputs, seed, biased)
                yield errors(truth, estimate(slave, CASES[case], VARIANTS[name], log, **{"filter.kind": kind}))

    return runs


def hold(found, bounds):
    for (name, (rms, largest, _)), (rms_bound, largest_bound) in zip(found.items(), bounds):
        assert rms <= rms_bound, (name, rms)
        assert largest <= largest_bound, (name, largest)


@pytest.mark.parametrize("case", CALIBRATED)
def test_a_calibrated_chair_is_as_near_as_the_reference(case, run):
    for found in run(case, "plain", BASIC, biased=False):
        hold(found, CALIBRATED[case])


@pytest.mark.parametrize("case", BOUNDS)
def test_unlike_chairs_with_biased_sensors(case, run):
    for chair in CHAIRS:
        for found in run(case, chair, BIAS, biased=True):
            hold(found, BOUNDS[case])


def test_deviations_are_honest_on_a_climb(run):
    """The slope's and the speed's, edges and unknown rolling resistance included."""
    shares = [[f[name][2] for name in ("slope", "speed")] for chair in CHAIRS for f in run("climb", chair, BIAS, True)]
    assert np.min(shares) >= 0.88, np.min(shares, axis=0)

"""Runs the reference experiment that an FMU carries: python verify.py MODEL.fmu (needs fmpy)."""
import sys
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np

folder = Path(fmpy.extract(sys.argv[1]))
extra = folder / "extra" / "org.fmi-standard.fmi-ls-ref"
experiment = ElementTree.parse(extra / "experiments.xml").getroot()[0]
start, stop, step, tolerance = (float(experiment.get(name)) for name in ("startTime", "stopTime", "stepSize", "tolerance"))
stimuli, expected = (fmpy.read_csv(str(extra / experiment.find(kind).get("source"))) for kind in ("Stimuli", "References"))
names = expected.dtype.names[1:]
result = fmpy.simulate_fmu(str(folder), start_time=start, stop_time=stop, output_interval=step, input=stimuli, output=names)
errors = {n: np.max(np.abs(result[n].astype(float) - expected[n]) / np.maximum(1.0, np.abs(expected[n]))) for n in names}
worst = max(errors, key=errors.get)
verdict = "verified" if errors[worst] <= tolerance else "DIFFERS"
print(f"{sys.argv[1]}: {verdict}; largest deviation {errors[worst]:.1e} of {worst}, allowed {tolerance:.0e}")
sys.exit(verdict != "verified")

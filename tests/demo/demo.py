"""Run NursingRobot.fmu over a log in fmpy; print, plot and report the estimates beside the truth."""

import argparse
import base64
import csv
import html
import json

import fmpy
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from fmpy.simulation import simulate_fmu

# One row per panel: FMU output, its name in the log's truth, unit as plotted, factor.
PANELS = [
    ("load_mass", "kg", 1.0),
    ("body_pitch", "mrad", 1e3),
    ("sway_force", "N", 1.0),
    ("speed_estimate", "m/s", 1.0),
]
TRUTH = {"speed_estimate": "true_speed"}


def read_log(path):
    """The log's columns as float arrays; empty cells are NaN."""
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    names = [name.strip() for name in rows[0]]
    values = np.array([[float(cell) if cell.strip() else np.nan for cell in row] for row in rows[1:]])
    return {name: values[:, i] for i, name in enumerate(names)}


def run(fmu, log, start_values):
    """The FMU's outputs over the log, one row per sample."""
    inputs = {v.name for v in fmpy.read_model_description(fmu).modelVariables if v.causality == "input"}
    names = ["time"] + [name for name in log if name in inputs]
    signals = np.array(list(zip(*(log[name] for name in names))), dtype=[(name, float) for name in names])
    # A NaN input says that there is no sample; inputs that the log lacks are never sampled.
    missing = {name: float("nan") for name in inputs if name not in log}
    time = log["time"]
    outputs = [name for name, _, _ in PANELS]
    outputs += [name + "_std" for name in outputs] + ["mass_valid", "healthy", "status"]
    return simulate_fmu(
        fmu,
        start_time=time[0],
        stop_time=time[-1],
        output_interval=float(np.median(np.diff(time))),
        input=signals,
        start_values={**missing, **start_values},
        output=outputs,
    )


def compare(log, result):
    """RMS error, share inside two standard deviations and final values, per estimate."""
    rows = []
    for name, unit, factor in PANELS:
        truth = log.get(TRUTH.get(name, "true_" + name))
        if truth is None:
            rows.append((name, unit, None, result[name][-1] * factor, result[name + "_std"][-1] * factor, None, None))
            continue
        reference = np.interp(result["time"], log["time"], truth)
        error = result[name] - reference
        use = result["mass_valid"].astype(bool) if name == "load_mass" else np.ones(len(error), bool)
        inside = np.abs(error) <= 2 * result[name + "_std"]
        rows.append((
            name, unit, reference[-1] * factor, result[name][-1] * factor, result[name + "_std"][-1] * factor,
            np.sqrt(np.mean(error[use] ** 2)) * factor if use.any() else None,
            100 * np.mean(inside[use]) if use.any() else None,
        ))
    return rows


def table(rows):
    """The comparison as aligned text."""
    cell = lambda value, form: "-" if value is None else format(value, form)
    lines = [f"{'estimate':<16}{'unit':>6}{'truth':>10}{'estimate':>10}{'std':>9}{'rms error':>11}{'in 2 std':>10}"]
    for name, unit, truth, value, std, rms, inside in rows:
        lines.append(f"{name:<16}{unit:>6}{cell(truth, '.2f'):>10}{cell(value, '.2f'):>10}{cell(std, '.2f'):>9}"
                     f"{cell(rms, '.3f'):>11}{cell(inside, '.0f') + (' %' if inside is not None else ''):>10}")
    return "\n".join(lines) + "\n(truth and estimate: last sample; rms error and share inside 2 std: whole run)"


def fitted(fit, log):
    """The fitted parameters as aligned text; the truth of a simulated log beside them."""
    lines = [f"{'parameter':<24}{'unit':>12}{'truth':>10}{'fitted':>10}{'95 % interval':>22}"]
    for name, p in fit["parameters"].items():
        truth = f"{log['true_' + name][0]:.4g}" if "true_" + name in log else "-"
        value, interval = "-", "not identified, kept"
        if p["identified"]:
            value, interval = f"{p['value']:.4g}", "{:.4g} .. {:.4g}".format(*p["ci95"])
        lines.append(f"{name:<24}{p['unit']:>12}{truth:>10}{value:>10}{interval:>22}")
    return "\n".join(lines)


def plot(log, result, path):
    figure, axes = plt.subplots(len(PANELS), 1, figsize=(9, 9), sharex=True, layout="constrained")
    for axis, (name, unit, factor) in zip(axes, PANELS):
        value, std = result[name] * factor, result[name + "_std"] * factor
        truth = log.get(TRUTH.get(name, "true_" + name))
        if name == "load_mass":
            valid = result["mass_valid"].astype(bool)
            value, std = np.where(valid, value, np.nan), np.where(valid, std, np.nan)
        axis.fill_between(result["time"], value - 2 * std, value + 2 * std, alpha=0.25, lw=0, label="±2 std")
        axis.plot(result["time"], value, lw=1.2, label="estimate")
        if truth is not None:
            axis.plot(log["time"], truth * factor, "k--", lw=0.9, label="truth")
        axis.set_ylabel(f"{name.replace('_', ' ')} / {unit}")
        axis.grid(alpha=0.3)
        # Wide enough for the usual band; short transients may leave the panel.
        low, high = np.nanpercentile(value, 1), np.nanpercentile(value, 99)
        margin = 2.5 * np.nanmedian(std) + 0.1 * (high - low) + 1e-9
        axis.set_ylim(low - margin, high + margin)
    axes[0].legend(loc="upper right", ncols=3, frameon=False)
    axes[-1].set_xlabel("time / s")
    figure.savefig(path, dpi=130)


def report(path, plot_path, texts):
    """One self-contained page."""
    image = base64.b64encode(open(plot_path, "rb").read()).decode()
    blocks = "".join(f"<h2>{html.escape(title)}</h2><pre>{html.escape(text)}</pre>" for title, text in texts)
    page = ("<!doctype html><meta charset='utf-8'><title>NursingRobot: fit and run</title>"
            "<style>body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}"
            "pre{background:#f5f5f5;padding:1rem;overflow-x:auto}img{max-width:100%}</style>"
            f"<h1>NursingRobot: fit and run</h1>{blocks}<h2>Over the ride</h2>"
            f"<img alt='estimates over the ride' src='data:image/png;base64,{image}'>")
    with open(path, "w") as file:
        file.write(page)


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    for name in ("fmu", "log", "fit", "fit-log", "result", "plot", "report"):
        arguments.add_argument("--" + name, required=True)
    a = arguments.parse_args()

    log = read_log(a.log)
    fit = json.load(open(a.fit))
    result = run(a.fmu, log, {})
    np.savetxt(a.result, np.array(result.tolist()), delimiter=",", header=",".join(result.dtype.names), comments="")

    texts = [("Fitted parameters, packed into the FMU", fitted(fit, read_log(a.fit_log))), ("Estimates", table(compare(log, result)))]
    for title, text in texts:
        print(f"\n{title}\n{text}")
    plot(log, result, a.plot)
    report(a.report, a.plot, texts)


if __name__ == "__main__":
    main()

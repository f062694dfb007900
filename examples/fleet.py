"""Fits a fleet: every log by itself, and every machine over all of its logs, on all cores of this computer or on a cluster.

    pip install wheelstate "dask[distributed]"
    python fleet.py nursing-robot LOGS --out fleet
    python fleet.py nursing-robot LOGS --out fleet --scheduler tcp://host:8786

LOGS holds logs, or one folder of logs per machine; the order of their names is taken for that of time. Files are read,
mapped and checked where the worker runs, which must see the same folder; what the fit needs of them travels as blocks. A
worker that is lost costs time only: its logs are done again, and the result is the same to the last bit.

Written are fleet.csv (every log and every machine), MACHINE.json and MACHINE.html, and fleet.html: what drifts over time,
which logs and machines stand out, and how likely that is by chance. Exit code: that of the worst fit.
"""

import argparse
import csv
import html
import math
import statistics
import sys
from dataclasses import dataclass
from pathlib import Path

import wheelstate
from distributed import Client, Future, LocalCluster, as_completed

ENDINGS = {".csv", ".gz", ".zst", ".parquet", ".mf4", ".mcap", ".blf", ".asc", ".log"}
CHANCE = 0.01  # what is less likely by chance is named


@dataclass
class Ride:
    """What a worker made of one log."""

    log: str
    block: wheelstate.Block | None
    fit: str | None
    refused: str | None


@dataclass
class Whole:
    """One machine over all of its logs."""

    fit: str
    page: str


def ride(vehicle: str, path: str, columns: str | None, alone: bool) -> Ride:
    """Reads, checks and packs one log and, if asked for, fits it alone. What is wrong with it is said, not raised."""
    try:
        log = wheelstate.read(path, columns, machine=vehicle)
        block = wheelstate.compress(vehicle, log)
        bad = [finding for finding in wheelstate.check(vehicle, log, expect=False) if finding.severity == "refusal"]
        if bad:
            return Ride(path, None, None, str(bad[0]))
        return Ride(path, block, wheelstate.fit(vehicle, log, progress=False).to_json() if alone else None, None)
    except wheelstate.Error as error:
        return Ride(path, None, None, str(error))


def whole(rides: list[Ride]) -> Whole | None:
    """The fit of one machine to all of its logs that can be used."""
    blocks = [one.block for one in rides if one.block is not None]
    if not blocks:
        return None
    fit = wheelstate.merge(blocks, progress=False)
    return Whole(fit.to_json(), fit.html())


def machines(folder: Path) -> dict[str, list[Path]]:
    """The logs of every machine, in the order of their names."""

    def logs(of: Path) -> list[Path]:
        return sorted(path for path in of.iterdir() if path.suffix.lower() in ENDINGS)

    own = {folder.name: logs(folder)} if logs(folder) else {}
    below = {path.name: logs(path) for path in sorted(folder.iterdir()) if path.is_dir()}
    return own | {name: found for name, found in below.items() if found}


def drift(points: list[tuple[float, float, float]]) -> tuple[float, float, float] | None:
    """Slope of (time, value, standard deviation) by weighted least squares, its standard deviation, and the probability of
    as steep a slope by chance. Scatter beyond the standard deviations widens the slope's own."""
    if len(points) < 4:
        return None
    weights = [1 / std**2 for _, _, std in points]
    total = sum(weights)
    centre = sum(w * t for w, (t, _, _) in zip(weights, points)) / total
    mean = sum(w * v for w, (_, v, _) in zip(weights, points)) / total
    spread = sum(w * (t - centre) ** 2 for w, (t, _, _) in zip(weights, points))
    slope = sum(w * (t - centre) * (v - mean) for w, (t, v, _) in zip(weights, points)) / spread
    chi2 = sum(w * (v - mean - slope * (t - centre)) ** 2 for w, (t, v, _) in zip(weights, points))
    std = math.sqrt(max(chi2 / (len(points) - 2), 1.0) / spread)
    return slope, std, math.erfc(abs(slope) / std / math.sqrt(2))


def outliers(values: dict[str, tuple[float, float]]) -> dict[str, float]:
    """Those of several (value, standard deviation) that stand out, with the probability of that by chance: their distance
    from the median over scatter (by the median absolute deviation) and own standard deviation, corrected for how many
    were looked at."""
    if len(values) < 5:
        return {}
    middle = statistics.median(value for value, _ in values.values())
    scatter = 1.4826 * statistics.median(abs(value - middle) for value, _ in values.values())
    found = {}
    for name, (value, std) in values.items():
        distance = abs(value - middle) / math.hypot(scatter, std)
        chance = min(1.0, len(values) * math.erfc(distance / math.sqrt(2)))
        if chance < CHANCE:
            found[name] = chance
    return found


def plot(title: str, points: list[tuple[str, float, float]]) -> str:
    """Values with two standard deviations in the order of time, as SVG."""
    low = min(value - 2 * std for _, value, std in points)
    high = max(value + 2 * std for _, value, std in points)
    size = (high - low) or abs(high) or 1.0

    def x(k: int) -> float:
        return 80 + 600 * (k + 0.5) / len(points)

    def y(value: float) -> float:
        return 30 + 160 * (high - value) / size

    marks = []
    for k, (name, value, std) in enumerate(points):
        top, bottom = y(value + 2 * std), y(value - 2 * std)
        words = html.escape(f"{name}: {value:.5g} +- {std:.2g}")
        marks.append(
            f'<g><title>{words}</title><line x1="{x(k):.1f}" x2="{x(k):.1f}" y1="{top:.1f}" y2="{bottom:.1f}" stroke="#7a9cc6"/>'
            f'<circle cx="{x(k):.1f}" cy="{y(value):.1f}" r="3" fill="#1f4e8c"/></g>'
        )
    digits = max(0, 2 - math.floor(math.log10(size)))
    axis = "".join(
        f'<text x="74" y="{y(value) + 4:.1f}" text-anchor="end">{value:.{digits}f}</text>'
        f'<line x1="80" x2="680" y1="{y(value):.1f}" y2="{y(value):.1f}" stroke="#dddddd"/>'
        for value in (low, low + size / 2, high)
    )
    ends = "".join(
        f'<text x="{x(k):.1f}" y="206" text-anchor="middle">{html.escape(points[k][0])}</text>' for k in (0, len(points) - 1)
    )
    return (
        f'<svg viewBox="0 0 700 210" role="img" aria-label="{html.escape(title)}"><text x="80" y="16" font-weight="bold">'
        f"{html.escape(title)}</text>{axis}{ends}{''.join(marks)}</svg>"
    )


def overview(results: dict[str, wheelstate.Fit]) -> str:
    """The parameters of all machines beside each other."""
    names = sorted({name for fit in results.values() for name in fit.parameters})
    head = "".join(f"<th>{html.escape(machine)}</th>" for machine in results)
    rows = []
    for name in names:
        cells = []
        for fit in results.values():
            found = fit.parameters.get(name)
            verdict = "" if found is None or found.identified else f" ({found.verdict.replace('-', ' ')})"
            cells.append(f"<td>{found.value:.4g} +- {found.std_error:.1g}{verdict}</td>" if found else "<td></td>")
        unit = next((fit[name].unit for fit in results.values() if name in fit.parameters), "1")
        rows.append(f"<tr><td>{html.escape(name)}{'' if unit == '1' else ', ' + html.escape(unit)}</td>{''.join(cells)}</tr>")
    return f"<table><tr><th>all logs</th>{head}</tr>{''.join(rows)}</table>"


def page(vehicle: str, lines: list[str], table: str, plots: list[str]) -> str:
    """The fleet's report: one file, no network, no scripts."""
    said = "".join(f"<li>{html.escape(line)}</li>" for line in lines) or "<li>nothing stands out</li>"
    style = "body{font:15px sans-serif;max-width:46em;margin:2em auto;padding:0 1em}svg{width:100%;font:11px sans-serif}"
    style += "table{border-collapse:collapse}td,th{text-align:left;padding:.2em 1em .2em 0;border-bottom:1px solid #dddddd}"
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{vehicle}: the fleet</title><style>{style}</style>'
        f"<h1>{vehicle}: the fleet</h1><h2>What stands out</h2><ul>{said}</ul><h2>Machines</h2>{table}<h2>Parameters</h2>"
        f"<p>Values with two standard deviations, in the order of time.</p>{''.join(plots)}</html>\n"
    )


def show(done: int, total: int) -> None:
    """Progress on stderr: a line that is written again on a terminal, twenty lines elsewhere."""
    if sys.stderr.isatty():
        print(f"\r{done} of {total} logs", end="\n" if done == total else "", file=sys.stderr, flush=True)
    elif done == total or done % math.ceil(total / 20) == 0:
        print(f"{done} of {total} logs", file=sys.stderr, flush=True)


def values(fit: wheelstate.Fit) -> dict[str, tuple[float, float]]:
    """What the data alone tell of each identified parameter: errors that all rides share would not tell them apart."""
    found = {}
    for name, told in fit.to_dict()["parameters"].items():
        if told["identified"] and (told.get("sampling_std") or 0) > 0:
            found[name] = (told["value"], told["sampling_std"])
    return found


def look(name: str, fits: dict[str, wheelstate.Fit]) -> tuple[list[str], list[str]]:
    """What stands out among the fits of one machine's logs, or of several machines; and plots."""
    lines, plots = [], []
    of = {key: values(fit) for key, fit in fits.items()}
    for parameter in sorted({parameter for each in of.values() for parameter in each}):
        known = {key: each[parameter] for key, each in of.items() if parameter in each}
        if len(known) < 2:
            continue
        unit = next(fit[parameter].unit for fit in fits.values() if parameter in fit.parameters)
        plots.append(plot(f"{name}: {parameter}" + ("" if unit == "1" else f", {unit}"), [(key, *pair) for key, pair in known.items()]))
        slope = drift([(float(k), *pair) for k, pair in enumerate(known.values())])
        if slope is not None and slope[2] < CHANCE:
            lines.append(f"{name}: {parameter} drifts by {slope[0]:.3g} +- {slope[1]:.1g} per log (p = {slope[2]:.1g})")
        for key, chance in outliers(known).items():
            lines.append(f"{name}: {parameter} of {key} is {known[key][0]:.5g}, far from the others (p = {chance:.1g})")
    return lines, plots


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("vehicle", help="nursing-robot, wheeled-robot, wheel-loader, human-dynamics or wheelchair")
    parser.add_argument("logs", type=Path, help="folder with logs, or with one folder of logs per machine")
    parser.add_argument("--columns", help="column map of all logs")
    parser.add_argument("--out", type=Path, default=Path("fleet"), help="folder for tables and reports")
    parser.add_argument("--scheduler", help="address of a Dask scheduler; without it: processes on this computer")
    parser.add_argument("--workers", type=int, help="how many processes on this computer")
    parser.add_argument("--no-alone", action="store_true", help="do not fit each log by itself")
    options = parser.parse_args()
    fleet = machines(options.logs)
    if not fleet:
        parser.error(f"{options.logs}: no logs")
    options.out.mkdir(parents=True, exist_ok=True)
    cluster = options.scheduler or LocalCluster(n_workers=options.workers, threads_per_worker=1, dashboard_address=None)
    with Client(cluster) as client:
        rides: dict[str, list[Future]] = {
            name: [client.submit(ride, options.vehicle, str(log), options.columns, not options.no_alone) for log in logs]
            for name, logs in fleet.items()
        }
        # A machine's blocks go from worker to worker; the fit begins when the last of them is there.
        wholes = {name: client.submit(whole, futures) for name, futures in rides.items()}
        everything = [future for futures in rides.values() for future in futures]
        for done, _ in enumerate(as_completed(everything), 1):
            show(done, len(everything))
        told = {name: client.gather(futures) for name, futures in rides.items()}
        joint = {name: client.gather(future) for name, future in wholes.items()}
    if not options.scheduler:
        cluster.close()

    lines: list[str] = []
    plots: list[str] = []
    table: list[tuple[object, ...]] = []
    code = 0
    results = {name: wheelstate.Fit.parse(found.fit, name) for name, found in joint.items() if found is not None}
    for name, of_machine in told.items():
        alone = {}
        for one in of_machine:
            log = Path(one.log).name
            if one.refused:
                lines.append(f"{name}: {log} was left out: {one.refused}")
                code = max(code, 1)
            elif one.fit:
                alone[log] = wheelstate.Fit.parse(one.fit, log)
        found_lines, found_plots = look(name, alone)
        lines, plots = lines + found_lines, plots + found_plots
        for log, fit in [*alone.items(), *([("all logs", results[name])] if name in results else [])]:
            table += [(name, log, p.name, p.value, p.std_error, p.unit, p.verdict) for p in fit.parameters.values()]
        if name in results:
            fit, found = results[name], joint[name]
            fit.save(options.out / f"{name}.json")
            (options.out / f"{name}.html").write_text(found.page, encoding="utf-8")
            code = max(code, fit.exit_code)
        else:
            code = 2
    if len(results) > 1:
        found_lines, found_plots = look("machines", results)
        lines, plots = lines + found_lines, found_plots + plots
        first, *others = results
        for other in others:
            for difference in wheelstate.compare(results[first], results[other]):
                if difference.p < CHANCE:
                    lines.append(
                        f"{other} and {first}: {difference.name} differs by {difference.difference:.3g} +- "
                        f"{difference.std:.1g} {difference.unit} (p = {difference.p:.1g})"
                    )
    with open(options.out / "fleet.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["machine", "log", "parameter", "value", "std_error", "unit", "verdict"])
        writer.writerows(table)
    (options.out / "fleet.html").write_text(page(options.vehicle, lines, overview(results), plots), encoding="utf-8")
    for line in lines:
        print(line)
    print(f"{options.out / 'fleet.html'}: {sum(map(len, fleet.values()))} logs of {len(fleet)} machines")
    return code


if __name__ == "__main__":
    sys.exit(main())

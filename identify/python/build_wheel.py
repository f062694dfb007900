"""Builds the wheel (PEP 517): first the FMUs and licences that it carries, then maturin.

WHEELSTATE_FMUS names a folder of FMUs that are ready; without it the library is built and packed here. WHEELSTATE_LIBRARIES
names a folder with libraries for several platforms, as `fmu/targets.sh` fills it. WHEELSTATE_EXTENSION names an extension
module that is already built, as the tests have it: then nothing is compiled.
"""

import json
import os
import shutil
import subprocess
import sysconfig
import tempfile
from pathlib import Path

import maturin
from maturin import get_requires_for_build_wheel, prepare_metadata_for_build_wheel  # noqa: F401

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PACKAGE = HERE / "wheelstate"
FMUS = PACKAGE / "fmus"


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    put_fmus()
    (PACKAGE / "licenses.txt").write_text(licences(), encoding="utf-8")
    if "WHEELSTATE_EXTENSION" in os.environ:
        return put_together(Path(wheel_directory), Path(os.environ["WHEELSTATE_EXTENSION"]))
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def metadata(*options):
    """What Cargo knows of the workspace."""
    command = [os.environ.get("CARGO", "cargo"), "metadata", "--format-version", "1", "--locked", *options]
    return json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout)


def licences():
    """The licences of all that is linked into the module: a list, then every text once with those that it is of."""
    told = metadata()
    packages = {package["id"]: package for package in told["packages"]}
    nodes = {node["id"]: node for node in told["resolve"]["nodes"]}
    (own,) = [key for key, package in packages.items() if package["name"] == "wheelstate-python"]
    linked, waiting = set(), [own]
    while waiting:
        key = waiting.pop()
        at_build = any("proc-macro" in target["kind"] for target in packages[key]["targets"])
        if key not in linked and not at_build:
            linked.add(key)
            normal = [dep for dep in nodes[key]["deps"] if any(kind["kind"] is None for kind in dep["dep_kinds"])]
            waiting += [dep["pkg"] for dep in normal]
    lines, texts = [], {}
    for package in sorted((packages[key] for key in linked), key=lambda package: (package["name"], package["version"])):
        name = f"{package['name']} {package['version']}"
        lines.append(f"{name}: {package['license']}")
        folder = Path(package["manifest_path"]).parent
        folder = ROOT if ROOT in folder.parents else folder
        for pattern in ("LICEN[CS]E*", "COPYING*", "NOTICE*"):
            for path in sorted(folder.glob(pattern)):
                if path.is_file():
                    texts.setdefault(path.read_text(encoding="utf-8", errors="replace").strip(), []).append(name)
    blocks = [", ".join(dict.fromkeys(names)) + "\n\n" + text for text, names in texts.items()]
    return ("\n\n" + 80 * "-" + "\n\n").join(["\n".join(lines), *blocks]) + "\n"


def put_fmus():
    """Puts the FMUs where maturin takes them from."""
    shutil.rmtree(FMUS, ignore_errors=True)
    FMUS.mkdir()
    if "WHEELSTATE_FMUS" in os.environ:
        for fmu in sorted(Path(os.environ["WHEELSTATE_FMUS"]).glob("*.fmu")):
            shutil.copy(fmu, FMUS)
    else:
        cargo = os.environ.get("CARGO", "cargo")
        build = [cargo, "build", "--release", "--locked", "--package", "wheelstate-fmu", "--lib", "--bin", "pack"]
        subprocess.run(build, cwd=ROOT, check=True)
        pack = Path(metadata("--no-deps")["target_directory"]) / "release" / "pack"
        libraries = os.environ.get("WHEELSTATE_LIBRARIES")
        subprocess.run([pack, "all", "--out", FMUS, *(["--libraries", libraries] if libraries else [])], check=True)
    if not any(FMUS.iterdir()):
        raise SystemExit(f"no .fmu in {os.environ['WHEELSTATE_FMUS']}")


def put_together(folder, extension):
    """The wheel around an extension module that is already built; metadata and tags are maturin's."""
    from wheel.wheelfile import WheelFile

    with tempfile.TemporaryDirectory() as temporary:
        tree = Path(temporary)
        info = tree / prepare_metadata_for_build_wheel(temporary)
        shutil.copytree(PACKAGE, tree / "wheelstate", ignore=shutil.ignore_patterns("__pycache__", "_native*.so", ".mypy_cache"))
        # Windows tells the stable interface by the ending alone.
        ending = "pyd" if sysconfig.get_platform().startswith("win") else "abi3.so"
        shutil.copy(extension, tree / "wheelstate" / f"_native.{ending}")
        (tag,) = [line.split()[1] for line in (info / "WHEEL").read_text().splitlines() if line.startswith("Tag:")]
        name = f"{info.name.removesuffix('.dist-info')}-{tag}.whl"
        with WheelFile(folder / name, "w") as wheel:
            wheel.write_files(tree)
    return name

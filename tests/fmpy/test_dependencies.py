"""Licences and the oldest Rust of all dependencies, from what Cargo has downloaded: `cargo deny` and the oldest compiler,
which the release workflow runs, are not everywhere."""

import json
import re
import shutil
import subprocess
import tomllib

import pytest

from conftest import ROOT


@pytest.fixture(scope="module")
def packages():
    """Every package of the workspace and its dependencies, with all features, on the platforms that are released."""
    command = [shutil.which("cargo"), "metadata", "--format-version", "1", "--locked", "--all-features",
               "--manifest-path", str(ROOT / "Cargo.toml")]
    for target in tomllib.loads((ROOT / "deny.toml").read_text())["graph"]["targets"]:
        command += ["--filter-platform", target]
    return json.loads(subprocess.run(command, capture_output=True, check=True).stdout)["packages"]


def allowed(licence, list_):
    """Whether an SPDX expression can be met with the licences of a list; `/` is an old way to write OR."""
    terms = re.findall(r"\(|\)|[^()\s]+(?: WITH [^()\s]+)?", licence.replace("/", " OR "))
    words = {"OR": "or", "AND": "and", "(": "(", ")": ")"}
    return eval(" ".join(words.get(term, str(term in list_)) for term in terms))


@pytest.mark.parametrize("licence,met", [("MIT", True), ("MIT/Apache-2.0", True), ("(MIT OR GPL-3.0) AND ISC", True),
                                         ("MIT AND GPL-3.0", False), ("Apache-2.0 WITH LLVM-exception", False)])
def test_expressions_of_licences_are_read(licence, met):
    assert allowed(licence, ["MIT", "Apache-2.0", "ISC"]) == met


def test_every_dependency_has_a_licence_that_may_be_shipped(packages):
    list_ = tomllib.loads((ROOT / "deny.toml").read_text())["licenses"]["allow"]
    refused = {p["name"]: p["license"] for p in packages if not allowed(p["license"] or "none", list_)}
    assert len(packages) > 100 and not refused


def test_no_dependency_asks_for_a_newer_rust_than_the_workspace(packages):
    number = lambda text: tuple(map(int, (text + ".0.0").split(".")[:3]))
    oldest = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["rust-version"]
    assert f"Rust {oldest}" in (ROOT / "README.md").read_text()
    newer = {p["name"]: p["rust_version"] for p in packages if p["rust_version"] and number(p["rust_version"]) > number(oldest)}
    assert not newer

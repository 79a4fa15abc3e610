"""The bill of materials lists what runs; scripts/sbom.sh checks it against CycloneDX's schema."""

from __future__ import annotations

import json
import sys
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from .scripts_folder import ROOT, script

sbom = script("sbom")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (Path(sys.prefix) / "share" / "rclpy").is_dir(),
        reason="ROS from wheels: a shell without ROS",
    ),
]


@pytest.fixture
def environment():
    """What cyclonedx-py says of this environment, as far as it is needed."""
    components = [
        {
            "type": "library",
            "bom-ref": f"{one.name}=={one.version}",
            "name": one.name,
            "version": one.version,
            "purl": f"pkg:pypi/{sbom.normal(one.name)}@{one.version}",
        }
        for one in metadata.distributions()
    ]
    refs = [one["bom-ref"] for one in components]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "metadata": {},
        "components": components,
        "dependencies": [{"ref": ref, "dependsOn": refs} for ref in refs],
    }


@pytest.fixture
def make(environment, tmp_path, capsys):
    def run():
        file = tmp_path / "environment.json"
        file.write_text(json.dumps(environment))
        code = sbom.main(str(file))
        output, errors = capsys.readouterr()
        return code, output, errors

    return run


def required():
    """Return name -> (version, hashes) of the run-time locks, read differently than by sbom.py."""
    found = {}
    for lock in ("runtime", "ros"):
        text = (ROOT / "requirements" / f"{lock}.txt").read_text(encoding="utf-8")
        for line in text.replace("\\\n", " ").splitlines():
            requirement, *digests = line.split("--hash=sha256:")
            parsed = Requirement(requirement)
            if parsed.marker is None or parsed.marker.evaluate():
                version = str(parsed.specifier)[2:]
                found[parsed.name] = version, sorted(digest.strip() for digest in digests)
    return found


def test_every_runtime_requirement_is_listed_with_version_hashes_and_licence(make):
    code, output, errors = make()
    assert (code, errors) == (0, "")
    listed = {}
    for component in json.loads(output)["components"]:
        [files] = [e for e in component["externalReferences"] if e["type"] == "distribution"]
        digests = sorted(one["content"] for one in files["hashes"])
        listed[sbom.normal(component["name"])] = component["version"], digests
        [licence] = component["licenses"]  # known of all: scripts/licences.py
        assert licence.get("expression") or licence["license"]["id"]
    assert listed == required()


def test_tools_are_not_listed_and_nothing_depends_on_them(make):
    document = json.loads(make()[1])
    refs = {component["bom-ref"] for component in document["components"]}
    assert not refs & {f"{name}=={metadata.version(name)}" for name in ("pytest", "mypy")}
    root, *others = document["dependencies"]
    assert root["ref"] == document["metadata"]["component"]["bom-ref"]
    assert f"numpy=={metadata.version('numpy')}" in root["dependsOn"]
    assert {one["ref"] for one in others} == refs
    assert all(refs.issuperset(one["dependsOn"]) for one in [root, *others])


def test_libraries_that_a_wheel_bundles_are_listed_with_their_hash(make):
    document = json.loads(make()[1])
    [fast_dds] = [one for one in document["components"] if one["name"] == "ros-fastrtps"]
    names = [one["name"] for one in fast_dds["components"]]
    assert any(name.startswith("libcrypto") for name in names)
    assert all(len(one["hashes"][0]["content"]) == 64 for one in fast_dds["components"])


def test_the_same_environment_gives_the_same_bytes(make, environment):
    first = make()
    environment["components"].reverse()
    second = make()
    assert json.loads(first[1])["components"] == json.loads(second[1])["components"]
    assert not any(word in first[1] for word in ("serialNumber", "timestamp", str(ROOT)))


def test_a_version_other_than_the_locked_one_is_refused(make, environment):
    [numpy] = [one for one in environment["components"] if one["name"] == "numpy"]
    numpy["version"] = "1.0"
    assert make()[::2] == (
        1,
        f"sbom: numpy 1.0 is installed, requirements/ pin {metadata.version('numpy')}\n",
    )


def test_a_requirement_that_is_not_installed_is_named(make, environment):
    environment["components"] = [c for c in environment["components"] if c["name"] != "click"]
    assert make()[::2] == (1, "sbom: not installed: click; run scripts/bootstrap.sh\n")

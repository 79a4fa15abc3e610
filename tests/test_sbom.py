"""The bill of materials lists what runs; scripts/sbom.sh checks it against CycloneDX's schema."""

import json
import sys
from contextlib import redirect_stderr, redirect_stdout
from importlib import metadata
from io import StringIO
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


def environment():
    """Return what cyclonedx-py says of this environment, as far as it is needed."""
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
    depends = [{"ref": ref, "dependsOn": refs} for ref in refs]
    return {"metadata": {}, "components": components, "dependencies": depends}


def make(folder, of):
    """Return exit code, output and errors of the script for an environment."""
    file = folder / "environment.json"
    file.write_text(json.dumps(of))
    with redirect_stdout(StringIO()) as output, redirect_stderr(StringIO()) as errors:
        code = sbom.main(str(file))
    return code, output.getvalue(), errors.getvalue()


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    """The bill of materials of this environment."""
    code, output, errors = make(tmp_path_factory.mktemp("sbom"), environment())
    assert (code, errors) == (0, "")
    return output


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


def test_every_runtime_requirement_is_listed_with_version_hashes_and_licence(text):
    listed = {}
    for component in json.loads(text)["components"]:
        [files] = [e for e in component["externalReferences"] if e["type"] == "distribution"]
        digests = sorted(one["content"] for one in files["hashes"])
        listed[sbom.normal(component["name"])] = component["version"], digests
        [licence] = component["licenses"]  # known of all: scripts/licences.py
        assert licence.get("expression") or licence["license"]["id"]
    assert listed == required()


def test_libraries_that_a_wheel_bundles_are_listed_with_their_hash(text):
    document = json.loads(text)
    [fast_dds] = [one for one in document["components"] if one["name"] == "ros-fastrtps"]
    names = [one["name"] for one in fast_dds["components"]]
    assert any(name.startswith("libcrypto") for name in names)
    assert all(len(one["hashes"][0]["content"]) == 64 for one in fast_dds["components"])


def test_the_same_environment_gives_the_same_bytes(text, tmp_path):
    other = environment()
    other["components"].reverse()
    assert json.loads(text)["components"] == json.loads(make(tmp_path, other)[1])["components"]
    assert not any(word in text for word in ("serialNumber", "timestamp", str(ROOT)))


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda numpy: numpy.update(version="1.0"), "numpy 1.0 is installed, requirements/ pin {}"),
        (
            lambda numpy: numpy.update(name="other"),
            "not installed: numpy; run scripts/bootstrap.sh",
        ),
    ],
    ids=["another version", "absent"],
)
def test_an_environment_other_than_the_locked_one_is_refused(edit, says, tmp_path):
    other = environment()
    edit(next(one for one in other["components"] if one["name"] == "numpy"))
    line = f"sbom: {says.format(metadata.version('numpy'))}\n"
    assert make(tmp_path, other)[::2] == (1, line)

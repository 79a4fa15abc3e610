"""The licence check: what it reads, what it refuses, and whether the list kept by hand is right."""

from __future__ import annotations

import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from .scripts_folder import ROOT, script

licences = script("licences")
TEXT = (ROOT / "requirements" / "licences.yaml").read_text(encoding="utf-8")
KNOWN = licences.known(TEXT)
SHARE = Path(sys.prefix) / "share"
IN_PACKAGE_XML = {
    "Apache License 2.0": "Apache-2.0",
    "Apache 2.0": "Apache-2.0",
    "BSD": "BSD-3-Clause",  # said by the LICENSE next to it
    "BSD-3-Clause": "BSD-3-Clause",
    "MIT": "MIT",
    "zlib License": "Zlib",
}


def found(name="thing", expression="UNKNOWN", classifier="UNKNOWN", text="UNKNOWN"):
    return {
        "Name": name,
        "Version": "1.0",
        "License-Expression": expression,
        "License-Classifier": classifier,
        "License-Metadata": text,
    }


@pytest.mark.parametrize(
    ("package", "licence"),
    [
        (found(expression="MIT", classifier="BSD License"), "MIT"),
        (found(text="Apache License, Version 2.0"), "Apache-2.0"),
        (found(classifier="DFSG approved; MIT License"), "MIT"),
        (found(classifier="MIT License", text="Copyright (c) 1999\nlong text"), "MIT"),
        (found(classifier="Apache Software License; BSD License"), None),
        (found(classifier="BSD License", text="BSD"), None),
        (found(), None),
    ],
)
def test_what_a_package_declares(package, licence):
    assert licences.declared(package, KNOWN) == licence


@pytest.mark.parametrize(
    ("expression", "allowed"),
    [
        ("MIT", True),
        ("GPL-3.0-only", False),
        ("MIT AND GPL-3.0-only", False),
        ("GPL-3.0-only OR MIT", True),
        ("GPL-3.0-only OR MIT AND LGPL-2.1-only", False),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception", True),
        ("(MIT OR GPL-3.0-only) AND MIT", False),
    ],
)
def test_what_is_permitted(expression, allowed):
    assert licences.permitted(expression, KNOWN.allowed) is allowed


@pytest.mark.parametrize(
    ("package", "running", "says"),
    [
        (found(expression="MIT"), True, None),
        (found(expression="MPL-2.0"), False, None),
        (found(expression="MPL-2.0"), True, "thing 1.0: MPL-2.0 is not allowed for what runs"),
        (
            found(expression="GPL-3.0-only"),
            False,
            "thing 1.0: GPL-3.0-only is not allowed for tools",
        ),
        (found(), True, "thing 1.0: declares no licence, or an ambiguous one"),
    ],
)
def test_what_is_refused(package, running, says):
    knowledge = KNOWN._replace(by_hand={})
    names = {"thing"}
    running, tools = (names, set()) if running else (set(), names)
    lines = licences.faults(licences.report([package], knowledge), running, tools, knowledge)
    assert len(lines) == (says is not None)
    assert says is None or lines[0].startswith(says)


def test_an_unneeded_entry_by_hand_has_to_go():
    knowledge = KNOWN._replace(by_hand={"thing": ("MIT", "LICENSE"), "gone": ("MIT", "LICENSE")})
    packages = licences.report([found(expression="MIT")], knowledge)
    lines = licences.faults(packages, {"thing"}, set(), knowledge)
    assert [line.split(": remove")[0] for line in lines] == [
        "thing 1.0: declares MIT itself",
        "gone: by_hand lists it, requirements/*.txt do not",
    ]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("allowed: []", "must have exactly the keys"),
        (TEXT.replace("packages: [numba]", "package: numba"), "needs licence, source and packages"),
        (TEXT.replace("packages: [numba]", "packages: [numba, numba]"), "numba is listed twice"),
    ],
)
def test_a_wrong_file_is_named(text, says):
    with pytest.raises(ValueError, match=says):
        licences.known(text)


def ros_manifests():
    return {
        name: SHARE / name.removeprefix("ros-").replace("-", "_") / "package.xml"
        for name, (_, source) in KNOWN.by_hand.items()
        if source.startswith("package.xml")
    }


@pytest.mark.skipif(not (SHARE / "rclpy").is_dir(), reason="ROS from wheels: a shell without ROS")
def test_the_list_by_hand_matches_the_manifests_of_the_ros_wheels():
    manifests = ros_manifests()
    assert len(manifests) > 60
    for name, file in manifests.items():
        tags = [tag.text for tag in ElementTree.parse(file).findall("license")]
        meant = sorted({IN_PACKAGE_XML[tag] for tag in tags})
        assert KNOWN.by_hand[name][0] == " AND ".join(meant), name

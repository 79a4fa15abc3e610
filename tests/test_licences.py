"""The licence check: which licence it takes a package to have, what it refuses, and its list kept by hand."""

import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from .scripts_folder import ROOT, script

licences = script("licences")
KNOWN = licences.known((ROOT / "requirements" / "licences.yaml").read_text(encoding="utf-8"))
SHARE = Path(sys.prefix) / "share"
IN_PACKAGE_XML = {
    "Apache License 2.0": "Apache-2.0",
    "Apache 2.0": "Apache-2.0",
    "BSD": "BSD-3-Clause",  # said by the LICENSE next to it
    "zlib License": "Zlib",
}


@pytest.mark.parametrize(
    ("expression", "classifier", "text", "running", "refused"),
    [
        ("MIT", "BSD License", "", True, None),
        ("", "", "Apache License, Version 2.0", True, None),
        ("", "DFSG approved; MIT License", "", True, None),
        ("", "Apache Software License; BSD License", "", True, "declares no licence, or an ambig"),
        ("", "BSD License", "BSD", True, "declares no licence, or an ambiguous one"),
        ("", "", "", True, "declares no licence, or an ambiguous one"),
        ("MPL-2.0", "", "", False, None),
        ("MPL-2.0", "", "", True, "MPL-2.0 is not allowed for what runs"),
        ("GPL-3.0-only", "", "", False, "GPL-3.0-only is not allowed for tools"),
        ("MIT AND GPL-3.0-only", "", "", True, "MIT AND GPL-3.0-only is not allowed"),
        ("GPL-3.0-only OR MIT", "", "", True, None),
        ("GPL-3.0-only OR MIT AND LGPL-2.1-only", "", "", True, "GPL-3.0-only OR MIT AND"),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception", "", "", True, None),
        (
            "(MIT OR GPL-3.0-only) AND MIT",
            "",
            "",
            True,
            "(MIT OR GPL-3.0-only) AND MIT is not allowed",
        ),
    ],
)
def test_what_is_refused(expression, classifier, text, running, refused):
    package = {
        "Name": "thing",
        "Version": "1.0",
        "License-Expression": expression or "UNKNOWN",
        "License-Classifier": classifier or "UNKNOWN",
        "License-Metadata": text or "UNKNOWN",
    }
    knowledge = KNOWN._replace(by_hand={})
    sets = ({"thing"}, set()) if running else (set(), {"thing"})
    lines = licences.faults(licences.report([package], knowledge), *sets, knowledge)
    assert [line.startswith(f"thing 1.0: {refused}") for line in lines] == [True] * bool(refused)


@pytest.mark.skipif(not (SHARE / "rclpy").is_dir(), reason="ROS from wheels: a shell without ROS")
def test_the_list_by_hand_matches_the_manifests_of_the_ros_wheels():
    count = 0
    for name, (licence, source) in KNOWN.by_hand.items():
        if source.startswith("package.xml"):
            file = SHARE / name.removeprefix("ros-").replace("-", "_") / "package.xml"
            tags = {tag.text for tag in ElementTree.parse(file).findall("license")}
            assert licence == " AND ".join(sorted(IN_PACKAGE_XML.get(t, t) for t in tags)), name
            count += 1
    assert count > 60

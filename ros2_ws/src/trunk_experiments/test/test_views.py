"""The RViz view and the layouts are well-formed, installed, and name only existing topics."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from trunk_control.laws import law_named
from trunk_core import topics
from trunk_core.parameters.declarations import values_of
from trunk_msgs_util.picture.shapes import Geometry, Scene, shapes
from trunk_sim.config import TrunkSimulator
from trunk_views.markers import MarkersConfig

PACKAGE = Path(__file__).parents[1]
RVIZ = sorted((PACKAGE / "rviz").glob("*.rviz"))
FIELDS = ("position", "velocity", "effort")


def known_topics():
    return {
        "/" + name: kind for name, kind in topics.evidence_types(("pid", "fuzzy_pid")).items()
    } | {"/" + name: kind for name, kind in topics.PICTURES.items()}


def names_in(topic):
    """Return the names that a JointState topic carries."""
    if topic.endswith("/state"):
        return law_named("pid").record_names
    return ("trunk",) if topic == "/effort_command" else ("hip", "trunk")


def displays(tree):
    for display in tree["Visualization Manager"]["Displays"]:
        if "Topic" in display:
            yield display


@pytest.mark.parametrize("path", RVIZ, ids=lambda p: p.name)
def test_rviz_shows_topics_that_exist_with_the_display_of_their_type(path):
    tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    manager = tree["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == MarkersConfig().frame
    shown = {d["Topic"]["Value"]: d["Class"].split("/")[1] for d in displays(tree)}
    assert shown
    for topic, display in shown.items():
        assert known_topics()[topic].rsplit("/", 1)[-1] == display
    geometry = Geometry.from_parameters(values_of(TrunkSimulator()))
    drawn = {s.name for s in shapes(geometry, Scene(0.0, 0.0))}
    assert {n for d in displays(tree) for n in d["Namespaces"]} == drawn


def test_plotjuggler_draws_series_that_exist():
    root = ElementTree.parse(PACKAGE / "layouts" / "plotjuggler.xml").getroot()
    curves = [curve.get("name") for curve in root.iter("curve")]
    assert len(curves) >= 10
    for curve in curves:
        topic, name, field = curve.rsplit("/", 2)
        assert known_topics()[topic] == topics.JOINT_STATE_TYPE
        assert name in names_in(topic), curve
        assert field in FIELDS
    splitter = root.find(".//DockSplitter")
    assert len(splitter) == int(splitter.get("count")) == len(splitter.get("sizes").split(";"))


def test_foxglove_draws_values_that_exist_in_panels_that_exist():
    layout = json.loads((PACKAGE / "layouts" / "foxglove.json").read_text(encoding="utf-8"))
    panels = layout["configById"]

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(layout["layout"])) == sorted(panels)
    for panel, config in panels.items():
        kind = panel.split("!")[0]
        if kind == "Plot":
            for path in config["paths"]:
                topic, field, index = re.fullmatch(
                    r"([\w/]+)\.(\w+)\[(\d+)\]", path["value"]
                ).groups()
                assert known_topics()[topic] == topics.JOINT_STATE_TYPE
                assert field in FIELDS
                name = names_in(topic)[int(index)]
                assert name == "trunk" or name in path["label"], path
        elif kind == "3D":
            assert {known_topics()[topic] for topic in config["topics"]} == {
                topics.MARKER_ARRAY_TYPE
            }
        else:
            assert config["topicPath"] in known_topics()


def test_views_are_installed():
    prefix = pytest.importorskip("ament_index_python.packages")
    share = Path(prefix.get_package_share_directory("trunk_experiments"))
    for folder in ("launch", "rviz", "layouts"):
        wanted = {path.name for path in (PACKAGE / folder).iterdir() if path.is_file()}
        assert wanted
        assert {path.name for path in (share / folder).iterdir()} >= wanted

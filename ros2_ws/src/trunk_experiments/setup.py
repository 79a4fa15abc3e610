from glob import glob
from xml.etree import ElementTree

from setuptools import find_packages, setup

manifest = ElementTree.parse("package.xml")
name = manifest.findtext("name")
maintainer = manifest.find("maintainer")

setup(
    name=name,
    version=manifest.findtext("version"),
    description=manifest.findtext("description"),
    license=manifest.findtext("license"),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get("email"),
    packages=find_packages(include=[name, f"{name}.*"]),
    package_data={
        name: [
            "py.typed",
            "config/*.yaml",
            "paper/*.html.j2",
            "paper/*.css",
            "schemas/*.json",
            "studies/*.yaml",
            "templates/controller/*.in",
            "templates/controller/*/*.in",
            "templates/controller/*/*/*.in",
            "gateway/page/*",
            "gateway/page/vendor/*",
            "views/report_assets/*",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
        (f"share/{name}", ["package.xml"]),
        (f"share/{name}/config", sorted(glob(f"{name}/config/*.yaml"))),
        (f"share/{name}/schemas", sorted(glob(f"{name}/schemas/*.json"))),
        (f"share/{name}/studies", sorted(glob(f"{name}/studies/*.yaml"))),
        (f"share/{name}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{name}/layouts", sorted(glob("layouts/*"))),
        (f"share/{name}/rviz", sorted(glob("rviz/*.rviz"))),
        (f"share/{name}/ros2_control", sorted(glob("ros2_control/*"))),
    ],
    zip_safe=False,
    extras_require={
        "test": ["pytest"],  # `colcon test` looks here for what runs the tests
        "gym": ["gymnasium"],
        "foxglove": ["foxglove-sdk"],
    },
    entry_points={
        "console_scripts": [
            "bare_pair = trunk_experiments.executables:bare_pair",
            "composed = trunk_experiments.executables:composed",
            "markers = trunk_experiments.executables:markers",
            "trunk = trunk_experiments.executables:trunk",
        ],
    },
)

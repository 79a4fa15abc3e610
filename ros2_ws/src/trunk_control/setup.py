from xml.etree import ElementTree

from setuptools import find_packages, setup

manifest = ElementTree.parse("package.xml")
name = manifest.findtext("name")
maintainer = manifest.find("maintainer")
laws = ["pid", "fuzzy_pid", "lqr", "computed_torque"]

setup(
    name=name,
    version=manifest.findtext("version"),
    description=manifest.findtext("description"),
    license=manifest.findtext("license"),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get("email"),
    packages=find_packages(include=[name, f"{name}.*"]),
    package_data={name: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
        (f"share/{name}", ["package.xml"]),
    ],
    zip_safe=False,
    extras_require={"test": ["pytest"]},  # `colcon test` looks here for what runs the tests
    entry_points={
        "console_scripts": [
            f"{name} = trunk_control.executables:{name}" for name in (*laws, "fuzzy_gains")
        ],
        "trunk.controllers": [f"{name} = trunk_control.{name}_law:LAW" for name in laws],
    },
)

import os
from glob import glob
from xml.etree import ElementTree

from setuptools import find_packages, setup

manifest = ElementTree.parse("package.xml")
name = manifest.findtext("name")
version = manifest.findtext("version")
maintainer = manifest.find("maintainer")
wheel = "TRUNK_WHEEL" in os.environ  # scripts/wheels.sh: no executables of nodes

setup(
    name=name,
    version=version,
    description=manifest.findtext("description"),
    license=manifest.findtext("license"),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get("email"),
    packages=find_packages(include=[name, f"{name}.*"]),
    package_data={
        name: [
            "py.typed",
            "export_c/templates/*.in",
            "templates/*/*.in",
            "templates/*/*/*.in",
            "templates/*/*/*/*.in",
            "lab/assets/*",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
        (f"share/{name}", ["package.xml"]),
        (f"share/{name}/config", sorted(glob("../trunk_runs/trunk_runs/config/*.yaml"))),
        (f"share/{name}/studies", sorted(glob("../trunk_studies/trunk_studies/studies/*.yaml"))),
        (f"share/{name}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{name}/layouts", sorted(glob("layouts/*"))),
        (f"share/{name}/rviz", sorted(glob("rviz/*.rviz"))),
    ],
    python_requires=">=3.10,<3.14",
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Science/Research",
        "License :: OSI Approved :: Apache Software License",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3",
        "Topic :: Scientific/Engineering",
        "Typing :: Typed",
    ],
    # For wheels (docs/maintaining.md): bounds that include what the locks pin. ROS 2 comes by package.xml.
    install_requires=[
        f"trunk_core=={version}",
        f"trunk_recording=={version}",
        f"trunk_msgs_util=={version}",
        f"trunk_sim=={version}",
        f"trunk_control=={version}",
        f"trunk_runs=={version}",
        f"trunk_evidence=={version}",
        f"trunk_views=={version}",
        f"trunk_studies=={version}",
        "click>=8.1,<9",
        "Jinja2>=3.1,<4",
        "matplotlib>=3.8,<4",
        "mcap>=1.1,<2",
        "numpy>=1.26,<3",
        "pyarrow>=15",
        "PyYAML>=6.0,<7",
        "rich>=13,<16",
    ],
    zip_safe=False,
    extras_require={
        "test": ["pytest"],  # `colcon test` looks here for what runs the tests
        "cluster": ["distributed"],
        "control": ["control"],
        "gym": ["gymnasium"],
        "lab": ["ziglang"],
        "notebook": ["pandas"],
    },
    entry_points={
        "console_scripts": [
            f"{script} = trunk_experiments.executables:{script}"
            for script in (["trunk"] if wheel else ["composed", "markers", "trunk"])
        ],
    },
)

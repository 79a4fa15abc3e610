from xml.etree import ElementTree

from setuptools import find_packages, setup

manifest = ElementTree.parse("package.xml")
name = manifest.findtext("name")
version = manifest.findtext("version")
maintainer = manifest.find("maintainer")

setup(
    name=name,
    version=version,
    description=manifest.findtext("description"),
    license=manifest.findtext("license"),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get("email"),
    packages=find_packages(include=[name, f"{name}.*"]),
    package_data={name: ["py.typed", "config/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
        (f"share/{name}", ["package.xml"]),
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
        "numpy>=1.26,<3",
    ],
    zip_safe=False,
    extras_require={"test": ["pytest"]},  # `colcon test` looks here for what runs the tests
)

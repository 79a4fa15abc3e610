"""What all packages share, without ROS and without files of runs: the same bits in CPython, numba and C.

Instants, elementary functions, mechanics, parameters with units, names of topics, plug-ins, compilation.
"""

# The project's packages, from the bottom to the top: each imports those before it alone.
PACKAGES = (
    "trunk_core",
    "trunk_recording",
    "trunk_msgs_util",
    "trunk_sim",
    "trunk_control",
    "trunk_runs",
    "trunk_evidence",
    "trunk_views",
    "trunk_studies",
    "trunk_experiments",
)

"""Any MCAP recording of ROS 2: written, read, mended. Knows no plant, no controller, no verdict."""

"""Running what a plan says: in the ROS 2 graph, and offline."""

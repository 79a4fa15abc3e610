"""What is to be run: which nodes, with which values, who acts when. No ROS."""

"""What a parameter is: declarations, units, files, tables in CSV, and what nodes share. No ROS."""

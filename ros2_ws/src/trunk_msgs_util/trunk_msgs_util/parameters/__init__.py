"""What a parameter is: declarations, files, and the settings that nodes share. No ROS."""

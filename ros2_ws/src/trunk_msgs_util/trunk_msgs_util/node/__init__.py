"""What all nodes share: lifecycle, parameters, executor, the process that runs them. Here ROS is imported."""

"""ROS nodes of the loaded controllers, with their parameters, topics, services and actions."""

"""Each loaded controller's ROS node: its parameters, topics, services and actions."""
